// In place of libfranka's header of this name.
#pragma once
#include <array>

namespace franka {
enum class RealtimeConfig { kEnforce, kIgnore };
struct Finishable {
    bool motion_finished = false;
};
class Torques : public Finishable {
public:
    explicit Torques(const std::array<double, 7> &torques) noexcept : tau_J(torques) {}
    std::array<double, 7> tau_J{};
};
}  // namespace franka
