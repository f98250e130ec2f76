// In place of ROS 2's header of this name.
#pragma once
namespace rclcpp_lifecycle {
class State {};
}  // namespace rclcpp_lifecycle
