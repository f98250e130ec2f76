// The scenario's arm, and the interfaces that the exported controller borrows.
#pragma once
#include <slidax_law_scenario.h>

#include <controller_interface/controller_interface.hpp>

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

std::unique_ptr<controller_interface::ControllerInterface> made_by_the_plugin();

namespace rig {
constexpr std::size_t kJoints = SLIDAX_LAW_JOINTS;
using controller_interface::CallbackReturn;
using controller_interface::return_type;
inline const rclcpp_lifecycle::State kState;

inline std::vector<double> q(kJoints);
inline std::vector<double> dq(kJoints);
inline std::vector<double> tau(kJoints);
inline slidax_law_plant plant;

inline void measure() {
    slidax_law_measurement measured{};
    slidax_law_measure(&plant, &measured);
    q.assign(measured.q, measured.q + kJoints);
    dq.assign(measured.dq, measured.dq + kJoints);
}

inline void lend(controller_interface::ControllerInterface &controller, bool all = true) {
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

// In another order than the law's.
inline trajectory_msgs::msg::JointTrajectory to(const std::vector<double> &there, int seconds) {
    trajectory_msgs::msg::JointTrajectory message;
    message.points.resize(1);
    for (std::size_t i = kJoints; i-- > 0;) {
        message.joint_names.push_back("joint_" + std::to_string(i + 1));
        message.points[0].positions.push_back(there[i]);
    }
    message.points[0].time_from_start.sec = seconds;
    return message;
}
}  // namespace rig
