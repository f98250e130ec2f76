// In place of realtime_tools' header of this name.
#pragma once
#include <rclcpp/rclcpp.hpp>

#include <memory>
#include <utility>

namespace realtime_tools {
template <class Message>
class RealtimePublisher {
public:
    explicit RealtimePublisher(std::shared_ptr<rclcpp::Publisher<Message>> publisher)
        : publisher_(std::move(publisher)) {}
    bool try_publish(const Message &message) {
        publisher_->sent.push_back(message);
        return true;
    }

private:
    std::shared_ptr<rclcpp::Publisher<Message>> publisher_;
};
}  // namespace realtime_tools
