"""The law in ROS 2: a controller for ros2_control, and a node in Python."""

from .export import export_ros2 as export_ros2
