// In place of libfranka's header of this name: what the exported program reads.
#pragma once
#include <array>

namespace franka {
struct RobotState {
    std::array<double, 7> q{};
    std::array<double, 7> dq{};
    double control_command_success_rate{};
};
}  // namespace franka
