// In place of libfranka's header of this name.
#pragma once
#include <cstdint>

namespace franka {
class Duration {
public:
    explicit Duration(std::uint64_t milliseconds) noexcept : milliseconds_(milliseconds) {}
    [[nodiscard]] double toSec() const noexcept { return static_cast<double>(milliseconds_) / 1e3; }

private:
    std::uint64_t milliseconds_;
};
}  // namespace franka
