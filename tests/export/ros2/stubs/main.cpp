// The exported controller through its life, on the scenario's arm. Prints one line for each thing that is shown.
#include <slidax_law_scenario.h>

#include <controller_interface/controller_interface.hpp>

#include <cmath>
#include <cstdio>
#include <vector>

std::unique_ptr<controller_interface::ControllerInterface> made_by_the_plugin();

namespace {
constexpr std::size_t kJoints = SLIDAX_LAW_JOINTS;
using controller_interface::CallbackReturn;
using controller_interface::return_type;
const rclcpp_lifecycle::State kState;

std::vector<double> q(kJoints);
std::vector<double> dq(kJoints);
std::vector<double> tau(kJoints);
slidax_law_plant plant;

void measure() {
    slidax_law_measurement measured{};
    slidax_law_measure(&plant, &measured);
    q.assign(measured.q, measured.q + kJoints);
    dq.assign(measured.dq, measured.dq + kJoints);
}

void lend(controller_interface::ControllerInterface &controller, bool all = true) {
    controller.command_interfaces_.clear();
    controller.state_interfaces_.clear();
    for (std::size_t i = 0; i < kJoints; ++i) {
        controller.command_interfaces_.emplace_back(&tau[i]);
    }
    for (auto *values : {&q, &dq}) {
        for (double &value : *values) {
            controller.state_interfaces_.emplace_back(&value);
        }
    }
    if (!all) {
        controller.state_interfaces_.pop_back();
    }
}

// The largest error of so many periods; -1 if an update ends with an error.
double moved(controller_interface::ControllerInterface &controller, int periods) {
    double largest = 0.0;
    for (int k = 0; k < periods; ++k) {
        measure();
        if (controller.update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            return -1.0;
        }
        slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
        const auto &told = controller.get_node()->publisher->sent.back();
        for (const auto &dimension : told.layout.dim) {
            if (dimension.label == "error") {
                for (std::size_t i = 0; i < kJoints; ++i) {
                    largest = std::fmax(largest, std::fabs(told.data.at(dimension.stride + i)));
                }
            }
        }
    }
    return largest;
}

void said(const char *what, bool so) {
    std::printf("%s %d %s\n", what, so, rclcpp::last_error.c_str());
}

trajectory_msgs::msg::JointTrajectory to(const std::vector<double> &there, int seconds) {
    trajectory_msgs::msg::JointTrajectory found;
    found.points.resize(1);
    // In another order than the law's.
    for (std::size_t i = kJoints; i-- > 0;) {
        found.joint_names.push_back("joint_" + std::to_string(i + 1));
        found.points[0].positions.push_back(there[i]);
    }
    found.points[0].time_from_start.sec = seconds;
    return found;
}
}  // namespace

int main() {
    auto controller = made_by_the_plugin();
    slidax_law_start(&plant);
    measure();
    std::printf("init %d\n", controller->on_init() == CallbackReturn::SUCCESS);
    std::printf("interfaces %zu %zu\n", controller->command_interface_configuration().names.size(),
                controller->state_interface_configuration().names.size());
    controller->rate = 500;
    said("wrong rate", controller->on_configure(kState) == CallbackReturn::ERROR);
    controller->rate = 1000;
    std::printf("configure %d\n", controller->on_configure(kState) == CallbackReturn::SUCCESS);
    lend(*controller, false);
    std::printf("an interface is missing %d\n", controller->on_activate(kState) == CallbackReturn::ERROR);
    lend(*controller);
    q[0] = std::nan("");
    said("no posture", controller->on_activate(kState) == CallbackReturn::ERROR);
    measure();
    std::printf("activate %d\n", controller->on_activate(kState) == CallbackReturn::SUCCESS);
    std::printf("hold %.2e\n", moved(*controller, 1500));
    std::vector<double> there = q;
    there[0] += 0.3;
    controller->get_node()->subscription->callback(to(there, 2));
    std::printf("trajectory %.2e\n", moved(*controller, 2500));
    measure();
    std::printf("there %.2e\n", std::fabs(q[0] - there[0]));
    auto with_finger = to(there, 2);
    with_finger.joint_names.insert(with_finger.joint_names.begin(), "finger");
    with_finger.points[0].positions.insert(with_finger.points[0].positions.begin(), 0.04);
    controller->get_node()->subscription->callback(with_finger);
    std::printf("finger: %s%s\n", rclcpp::last_warning.c_str(), rclcpp::last_error.empty() ? "" : " and refused");
    auto wrong = to(there, 2);
    wrong.joint_names[0] = "elbow";
    controller->get_node()->subscription->callback(wrong);
    std::printf("wrong name: %s\n", rclcpp::last_error.c_str());
    there[0] = std::nan("");
    controller->get_node()->subscription->callback(to(there, 1));
    const double after = moved(*controller, 100);
    std::printf("not finite %.2e refused %.0f\n", after, controller->get_node()->publisher->sent.back().data.back());
    for (int k = 0; k < 20; ++k) {
        q[0] = std::nan("");
        if (controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            std::printf("stopped after %d\n", k + 1);
            break;
        }
    }
    bool finite = true;
    for (const double value : tau) {
        finite = finite && std::isfinite(value);
    }
    std::printf("finite %d\n", finite);
    said("deactivate", controller->on_deactivate(kState) == CallbackReturn::SUCCESS);
    measure();
    std::printf("again %d\n", controller->on_activate(kState) == CallbackReturn::SUCCESS && moved(*controller, 200) >= 0);
    std::printf("error %d\n", controller->on_error(kState) == CallbackReturn::SUCCESS);
    std::printf("configure again %d\n", controller->on_configure(kState) == CallbackReturn::SUCCESS);
    std::printf("cleanup %d\n", controller->on_cleanup(kState) == CallbackReturn::SUCCESS);
    std::printf("shutdown %d\n", controller->on_shutdown(kState) == CallbackReturn::SUCCESS);
    return 0;
}
