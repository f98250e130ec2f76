// Goals for the exported controller's action, on the scenario's arm. Prints a name and a number, or a result, in a line.
#include "rig.hpp"

#include "slidax_law_controller/parameters.hpp"

#include <control_msgs/action/follow_joint_trajectory.hpp>
#include <rclcpp_action/rclcpp_action.hpp>

#include <random>

using namespace rig;  // NOLINT: a test
using Action = control_msgs::action::FollowJointTrajectory;
using Handle = std::shared_ptr<rclcpp_action::ServerGoalHandle<Action>>;
using Server = rclcpp_action::Server<Action>;

namespace {
std::unique_ptr<controller_interface::ControllerInterface> controller;
std::mt19937 random_numbers(1);
double largest_jump = 0.0;    // share of the rate limit
double largest_torque = 0.0;  // share of the torque limit
double largest_reference_jump = 0.0;  // rad in a period
std::vector<double> wanted_before;

double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_numbers); }

Server &server() { return *std::static_pointer_cast<Server>(controller->get_node()->server); }

void report() { controller->get_node()->timer->callback(); }

// The reference: the measured position minus the error, of the last update.
std::vector<double> reference() {
    const auto &state = controller->get_node()->publisher->sent.back();
    for (const auto &dimension : state.layout.dim) {
        if (dimension.label == "error") {
            std::vector<double> positions;
            for (std::size_t i = 0; i < kJoints; ++i) {
                positions.push_back(q[i] - state.data.at(dimension.stride + i));
            }
            return positions;
        }
    }
    return {};
}

bool moved(int periods) {
    const auto &limits = slidax_law_controller::parameters.limits;
    for (int k = 0; k < periods; ++k) {
        const std::vector<double> before = tau;
        measure();
        if (controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            return false;
        }
        const std::vector<double> wanted = reference();
        for (std::size_t i = 0; i < kJoints; ++i) {
            largest_jump = std::fmax(largest_jump, std::fabs(tau[i] - before[i]) / (limits.rate[i] * SLIDAX_LAW_PERIOD));
            largest_torque = std::fmax(largest_torque, std::fabs(tau[i]) / limits.torque[i]);
            largest_reference_jump = std::fmax(largest_reference_jump, std::fabs(wanted[i] - wanted_before[i]));
        }
        wanted_before = wanted;
        slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
        if (k % 20 == 0) {
            report();
        }
        controller->get_node()->publisher->sent.erase(controller->get_node()->publisher->sent.begin(),
                                                      controller->get_node()->publisher->sent.end() - 1);
    }
    report();
    return true;
}

// From the reference, through a random way point or not, with times that a limit may forbid.
Action::Goal anywhere(double slow) {
    Action::Goal goal;
    goal.trajectory = to(reference(), 0);
    const int points = uniform(0.0, 1.0) < 0.5 ? 1 : 2;
    double t = 0.0;
    for (int k = 0; k < points; ++k) {
        t += slow * uniform(0.5, 1.5);
        std::vector<double> there;
        for (std::size_t i = 0; i < kJoints; ++i) {
            there.push_back(uniform(-0.8, 0.8));
        }
        auto point = to(there, 0).points[0];
        point.time_from_start.sec = static_cast<std::int32_t>(t);
        point.time_from_start.nanosec = static_cast<std::uint32_t>(1e9 * (t - point.time_from_start.sec));
        goal.trajectory.points.push_back(point);
    }
    if (points == 1) {
        for (auto &point : goal.trajectory.points) {
            point.velocities.assign(kJoints, 0.0);
            point.accelerations.assign(kJoints, 0.0);
        }
    }
    return goal;
}

void print(const char *what, const Handle &handle) {
    const char *const states[] = {"executing", "canceling", "succeeded", "canceled", "aborted"};
    std::printf("%s: %s %d %s\n", what, states[static_cast<int>(handle->state)],
                handle->result ? handle->result->error_code : 99,
                handle->result ? handle->result->error_string.c_str() : "");
}

bool ended(const Handle &handle, rclcpp_action::GoalState state, int code) {
    return handle->result && handle->state == state && handle->result->error_code == code;
}

void activate(bool retime) {
    slidax_law_controller::parameters.retime = retime;
    (void)controller->on_deactivate(kState);
    slidax_law_start(&plant);
    measure();
    (void)controller->on_activate(kState);
    wanted_before = q;
    std::copy(q.begin(), q.end(), wanted_before.begin());
    tau.assign(kJoints, 0.0);
    measure();
    (void)controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD));
    slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
    wanted_before = reference();
    (void)moved(1500);
}
}  // namespace

int main() {
    auto &parameters = slidax_law_controller::parameters;
    // The true arm is heavier than the nominal one.
    parameters.limits.torque_share = 0.7;
    controller = made_by_the_plugin();
    (void)controller->on_init();
    (void)controller->on_configure(kState);
    lend(*controller);
    std::printf("name: %s\n", server().name.c_str());
    std::printf("inactive: %d\n", server().goal({}) == nullptr);
    activate(false);

    int succeeded = 0, refused = 0, wrong = 0;
    for (int k = 0; k < 200; ++k) {
        const Handle handle = server().goal(anywhere(2.0));
        if (handle->result) {
            refused += ended(handle, rclcpp_action::GoalState::ABORTED, Action::Result::INVALID_GOAL) ? 1 : 0;
            wrong += moved(50) ? 0 : 1;
            continue;
        }
        wrong += moved(7200) && handle->feedback ? 0 : 1;
        succeeded += ended(handle, rclcpp_action::GoalState::SUCCEEDED, Action::Result::SUCCESSFUL) ? 1 : 0;
    }
    std::printf("succeeded: %d\nrefused: %d\nwrong: %d\n", succeeded, refused, wrong);

    int preempted = 0, slowed = 0;
    activate(true);
    for (int k = 0; k < 65; ++k) {
        const Handle first = server().goal(anywhere(1.0));
        wrong += moved(static_cast<int>(uniform(30.0, 450.0))) ? 0 : 1;
        const bool was_active = !first->result;
        const Handle second = server().goal(anywhere(1.5));
        if (second->result) {
            // Refused: the first one goes on.
            wrong += was_active && first->result ? 1 : 0;
        } else if (was_active) {
            preempted += ended(first, rclcpp_action::GoalState::ABORTED, Action::Result::INVALID_GOAL) ? 1 : 0;
        }
        const Handle &last = second->result ? first : second;
        for (int seconds = 0; seconds < 40 && !last->result; ++seconds) {
            wrong += moved(1000) ? 0 : 1;
        }
        wrong += last->result ? 0 : 1;
        slowed += last->result && last->result->error_string.rfind("slowed", 0) == 0 ? 1 : 0;
    }
    std::printf("preempted: %d\nslowed: %d\nwrong then: %d\n", preempted, slowed, wrong);

    int canceled = 0, asked = 0;
    for (int k = 0; k < 65; ++k) {
        const Handle handle = server().goal(anywhere(1.0));
        wrong += moved(static_cast<int>(uniform(0.0, 480.0))) ? 0 : 1;
        if (handle->result || !server().cancel(handle)) {
            continue;
        }
        asked += 1;
        wrong += moved(1200) ? 0 : 1;
        const std::vector<double> there = reference();
        wrong += moved(20) && reference() == there ? 0 : 1;
        canceled += ended(handle, rclcpp_action::GoalState::CANCELED, 0) ? 1 : 0;
    }
    std::printf("canceled: %d of %d\nwrong at last: %d\n", canceled, asked, wrong);

    auto goal = anywhere(1.0);
    goal.trajectory.joint_names[0] = "elbow";
    print("wrong joint", server().goal(goal));
    goal = anywhere(1.0);
    goal.trajectory.points[1].positions[0] = std::nan("");
    print("not finite", server().goal(goal));
    goal = anywhere(1.0);
    goal.path_tolerance.push_back({"finger", 0.1, 0.0, 0.0});
    print("tolerance of nobody", server().goal(goal));
    goal = anywhere(1.0);
    for (double &position : goal.trajectory.points[0].positions) {
        position += 0.4;
    }
    print("starts elsewhere", server().goal(goal));
    auto strong = to({reference()[0] + 0.9, reference()[1]}, 0);
    strong.points[0].time_from_start.nanosec = 200000000;
    goal = Action::Goal();
    goal.trajectory = strong;
    parameters.retime = false;
    activate(false);
    print("too strong", server().goal(goal));
    activate(true);
    Handle handle = server().goal(goal);
    (void)moved(5000);
    print("slowed down", handle);
    parameters.limits.torque_share = 0.95;
    activate(false);
    goal = Action::Goal();
    goal.trajectory = to({-0.5, 0.5}, 4);
    goal.path_tolerance = {{"joint_2", 1e-7, 0.0, 0.0}};
    handle = server().goal(goal);
    (void)moved(5000);
    print("path tolerance", handle);
    goal.path_tolerance.clear();
    goal.goal_tolerance = {{"joint_1", 1e-13, 0.0, 0.0}};
    goal.goal_time_tolerance.nanosec = 50000000;
    handle = server().goal(goal);
    (void)moved(4040);
    print("goal tolerance, waiting", handle);
    (void)moved(100);
    print("goal tolerance", handle);
    // A client that is lost: nobody keeps the handle, and the arm arrives.
    goal = Action::Goal();
    goal.trajectory = to({0.5, -0.5}, 4);
    (void)server().goal(goal);
    (void)moved(4500);
    std::printf("lost client: %.1e\n", std::fabs(reference()[0] - 0.5) + std::fabs(q[0] - 0.5));
    goal.trajectory = to({0.0, 0.0}, 4);
    handle = server().goal(goal);
    controller->get_node()->subscription->callback(to({0.4, -0.4}, 4));
    print("topic", handle);
    handle = server().goal(goal);
    (void)moved(100);
    (void)controller->on_deactivate(kState);
    print("deactivated", handle);
    std::printf("jump: %.6f\ntorque: %.6f\nreference: %.6f\n", largest_jump, largest_torque, largest_reference_jump);
    return 0;
}
