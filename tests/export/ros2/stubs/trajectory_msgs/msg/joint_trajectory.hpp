// In place of ROS 2's header of this name.
#pragma once
#include <rclcpp/rclcpp.hpp>

#include <string>
#include <vector>

namespace trajectory_msgs::msg {
struct JointTrajectoryPoint {
    std::vector<double> positions;
    std::vector<double> velocities;
    std::vector<double> accelerations;
    std::vector<double> effort;
    builtin_interfaces::msg::Duration time_from_start;
};
struct JointTrajectory {
    std::vector<std::string> joint_names;
    std::vector<JointTrajectoryPoint> points;
};
}  // namespace trajectory_msgs::msg
