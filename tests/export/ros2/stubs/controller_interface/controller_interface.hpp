// In place of ros2_control's header of this name.
#pragma once
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/state.hpp>
#include <std_msgs/msg/float64_multi_array.hpp>
#include <trajectory_msgs/msg/joint_trajectory.hpp>

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace controller_interface {
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names;
};

class Node {
public:
    [[nodiscard]] rclcpp::Logger get_logger() const { return {}; }

    template <typename Message>
    std::shared_ptr<rclcpp::Publisher<Message>> create_publisher(const std::string &, rclcpp::SystemDefaultsQoS) {
        publisher = std::make_shared<rclcpp::Publisher<Message>>();
        return publisher;
    }

    template <typename Message>
    std::shared_ptr<rclcpp::Subscription<Message>> create_subscription(
        const std::string &, rclcpp::SystemDefaultsQoS, std::function<void(const Message &)> callback) {
        const auto made = std::make_shared<rclcpp::Subscription<Message>>();
        made->callback = std::move(callback);
        if constexpr (std::is_same_v<Message, trajectory_msgs::msg::JointTrajectory>) {
            subscription = made;
        } else {
            positions = made;
        }
        return made;
    }

    std::shared_ptr<rclcpp::TimerBase> create_wall_timer(std::chrono::milliseconds, std::function<void()> callback) {
        timer = std::make_shared<rclcpp::TimerBase>();
        timer->callback = std::move(callback);
        return timer;
    }
    [[nodiscard]] rclcpp::Time now() const { return {}; }
    [[nodiscard]] const char *get_name() const { return "law"; }

    std::shared_ptr<void> server;
    std::shared_ptr<rclcpp::TimerBase> timer;
    std::shared_ptr<rclcpp::Publisher<std_msgs::msg::Float64MultiArray>> publisher;
    std::shared_ptr<rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>> subscription;
    std::shared_ptr<rclcpp::Subscription<std_msgs::msg::Float64MultiArray>> positions;
};

class LoanedInterface {
public:
    explicit LoanedInterface(double *value) : value_(value) {}
    template <typename T = double>
    [[nodiscard]] std::optional<T> get_optional() const {
        return value_ == nullptr ? std::nullopt : std::optional<T>(*value_);
    }
    [[nodiscard]] bool set_value(double value) {
        if (value_ == nullptr) {
            return false;
        }
        *value_ = value;
        return true;
    }

private:
    double *value_;
};

class ControllerInterface {
public:
    virtual ~ControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    [[nodiscard]] virtual InterfaceConfiguration command_interface_configuration() const = 0;
    [[nodiscard]] virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_error(const rclcpp_lifecycle::State &) = 0;
    virtual CallbackReturn on_shutdown(const rclcpp_lifecycle::State &) = 0;
    virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    [[nodiscard]] std::shared_ptr<Node> get_node() const { return node_; }
    [[nodiscard]] unsigned int get_update_rate() const { return rate; }

    std::vector<LoanedInterface> command_interfaces_;
    std::vector<LoanedInterface> state_interfaces_;
    unsigned int rate = 1000;

private:
    std::shared_ptr<Node> node_ = std::make_shared<Node>();
};
}  // namespace controller_interface
