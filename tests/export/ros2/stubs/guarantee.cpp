// Goals for a controller that takes only those inside the guarantee of its law. Prints a name and a number in a line.
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
double largest_error = 0.0;

double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_numbers); }

Handle goal_of(const trajectory_msgs::msg::JointTrajectory &trajectory) {
    Action::Goal goal;
    goal.trajectory = trajectory;
    return std::static_pointer_cast<Server>(controller->get_node()->server)->goal(goal);
}

// One point, at rest: of fifth order in time.
trajectory_msgs::msg::JointTrajectory quintic(const std::vector<double> &there, double seconds) {
    auto trajectory = to(there, static_cast<int>(seconds));
    auto &point = trajectory.points[0];
    point.time_from_start.nanosec = static_cast<std::uint32_t>(1e9 * (seconds - std::floor(seconds)));
    point.velocities.assign(kJoints, 0.0);
    point.accelerations.assign(kJoints, 0.0);
    return trajectory;
}

bool moved(int periods) {
    for (int k = 0; k < periods; ++k) {
        measure();
        if (controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            return false;
        }
        auto &sent = controller->get_node()->publisher->sent;
        for (const auto &dimension : sent.back().layout.dim) {
            for (std::size_t i = 0; dimension.label == "error" && i < kJoints; ++i) {
                largest_error = std::fmax(largest_error, std::fabs(sent.back().data.at(dimension.stride + i)));
            }
        }
        sent.erase(sent.begin(), sent.end() - 1);
        slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
        if (k % 20 == 0) {
            controller->get_node()->timer->callback();
        }
    }
    return true;
}

void print(const char *what, const Handle &handle) {
    std::printf("%s: %d %s\n", what, handle->result ? handle->result->error_code : 99,
                handle->result ? handle->result->error_string.c_str() : "");
}

void activate() {
    (void)controller->on_deactivate(kState);
    slidax_law_start(&plant);
    measure();
    (void)controller->on_activate(kState);
    (void)moved(2500);
}

void random_goals(int count) {
    int taken = 0, slowed = 0, refused = 0, wrong = 0;
    largest_error = 0.0;
    for (int k = 0; k < count; ++k) {
        const Handle handle = goal_of(quintic({uniform(-0.6, 0.6), uniform(-0.6, 0.6)}, uniform(0.5, 2.0)));
        if (handle->result) {
            refused += handle->result->error_code == Action::Result::INVALID_GOAL ? 1 : 0;
            continue;
        }
        for (int seconds = 0; seconds < 20 && !handle->result; ++seconds) {
            wrong += moved(1000) ? 0 : 1;
        }
        wrong += moved(1500) && handle->result && handle->result->error_code == 0 ? 0 : 1;
        taken += 1;
        slowed += handle->result->error_string.rfind("slowed", 0) == 0 ? 1 : 0;
    }
    std::printf("taken: %d\nslowed: %d\nrefused: %d\nwrong: %d\nerror: %.3e\n", taken, slowed, refused, wrong, largest_error);
}
}  // namespace

int main() {
    auto &parameters = slidax_law_controller::parameters;
    parameters.limits.torque_share = 1.0;
    parameters.guarantee.error.assign(kJoints, 1.4e-4);
    parameters.guarantee.assume_steps = true;
    controller = made_by_the_plugin();
    (void)controller->on_init();
    (void)controller->on_configure(kState);
    lend(*controller);
    activate();
    random_goals(12);
    print("fast", goal_of(quintic({0.6, -0.6}, 0.6)));
    const Handle slow = goal_of(quintic({0.3, 0.3}, 4.0));
    (void)moved(500);
    print("in a motion", goal_of(quintic({-0.3, 0.3}, 4.0)));
    print("goes on", slow);
    (void)moved(5500);
    print("arrived", slow);
    parameters.retime = true;
    activate();
    random_goals(4);
    parameters.law.kp *= 1.01;
    activate();
    print("other gains", goal_of(quintic({0.1, 0.1}, 4.0)));
    parameters.guarantee.required = false;
    activate();
    print("not required", goal_of(quintic({0.1, 0.1}, 4.0)));
    return 0;
}
