// In place of ROS 2's header of this name.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace std_msgs::msg {
struct MultiArrayDimension {
    std::string label;
    std::uint32_t size = 0;
    std::uint32_t stride = 0;
};
struct MultiArrayLayout {
    std::vector<MultiArrayDimension> dim;
    std::uint32_t data_offset = 0;
};
struct Float64MultiArray {
    MultiArrayLayout layout;
    std::vector<double> data;
};
}  // namespace std_msgs::msg
