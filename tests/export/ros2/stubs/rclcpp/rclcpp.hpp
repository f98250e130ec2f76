// In place of ROS 2's header of this name: what the exported controller uses, in one process.
#pragma once
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace builtin_interfaces::msg {
struct Duration {
    std::int32_t sec = 0;
    std::uint32_t nanosec = 0;
};
struct Time {
    std::int32_t sec = 0;
    std::uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace rclcpp {
class Duration {
public:
    explicit Duration(const builtin_interfaces::msg::Duration &message)
        : seconds_(message.sec + 1e-9 * message.nanosec) {}
    static Duration from_seconds(double seconds) { return Duration(seconds); }
    [[nodiscard]] double seconds() const { return seconds_; }
    // NOLINTNEXTLINE: implicit, as in ROS 2
    operator builtin_interfaces::msg::Duration() const {
        const auto whole = static_cast<std::int32_t>(seconds_);
        return {whole, static_cast<std::uint32_t>(1e9 * (seconds_ - whole))};
    }

private:
    explicit Duration(double seconds) : seconds_(seconds) {}
    double seconds_;
};
class Time {
public:
    // NOLINTNEXTLINE: implicit, as in ROS 2
    operator builtin_interfaces::msg::Time() const { return {}; }
};
class TimerBase {
public:
    std::function<void()> callback;
};
struct Logger {};
struct SystemDefaultsQoS {};

template <typename Message>
class Publisher {
public:
    std::vector<Message> sent;
};

template <typename Message>
class Subscription {
public:
    std::function<void(const Message &)> callback;
};

inline std::string last_error;    // NOLINT: for the test to read
inline std::string last_warning;  // NOLINT: for the test to read
}  // namespace rclcpp

#define RCLCPP_WARN(logger, ...)                                 \
    do {                                                         \
        (void)(logger);                                          \
        char text[500];                                          \
        (void)std::snprintf(text, sizeof text, __VA_ARGS__);     \
        rclcpp::last_warning = text;                             \
    } while (false)

#define RCLCPP_ERROR(logger, ...)                                \
    do {                                                         \
        (void)(logger);                                          \
        char text[500];                                          \
        (void)std::snprintf(text, sizeof text, __VA_ARGS__);     \
        rclcpp::last_error = text;                               \
    } while (false)
