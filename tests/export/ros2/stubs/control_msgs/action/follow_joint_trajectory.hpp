// In place of control_msgs' header of this name.
#pragma once
#include <rclcpp/rclcpp.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace std_msgs::msg {
struct Header {
    builtin_interfaces::msg::Time stamp;
    std::string frame_id;
};
}  // namespace std_msgs::msg

namespace control_msgs::msg {
struct JointTolerance {
    std::string name;
    double position = 0.0;
    double velocity = 0.0;
    double acceleration = 0.0;
};
}  // namespace control_msgs::msg

namespace control_msgs::action {
struct FollowJointTrajectory {
    struct Goal {
        trajectory_msgs::msg::JointTrajectory trajectory;
        std::vector<control_msgs::msg::JointTolerance> path_tolerance;
        std::vector<control_msgs::msg::JointTolerance> goal_tolerance;
        builtin_interfaces::msg::Duration goal_time_tolerance;
    };
    struct Result {
        static constexpr std::int32_t SUCCESSFUL = 0;
        static constexpr std::int32_t INVALID_GOAL = -1;
        static constexpr std::int32_t INVALID_JOINTS = -2;
        static constexpr std::int32_t OLD_HEADER_TIMESTAMP = -3;
        static constexpr std::int32_t PATH_TOLERANCE_VIOLATED = -4;
        static constexpr std::int32_t GOAL_TOLERANCE_VIOLATED = -5;
        std::int32_t error_code = 0;
        std::string error_string;
    };
    struct Feedback {
        std_msgs::msg::Header header;
        std::vector<std::string> joint_names;
        trajectory_msgs::msg::JointTrajectoryPoint desired;
        trajectory_msgs::msg::JointTrajectoryPoint actual;
        trajectory_msgs::msg::JointTrajectoryPoint error;
    };
};
}  // namespace control_msgs::action
