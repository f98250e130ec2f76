// In place of ROS 2's header of this name: a server whose goals a test hands in. A transition that ROS 2's goal state
// machine does not allow throws, as there.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

namespace rclcpp_action {
using GoalUUID = std::array<std::uint8_t, 16>;
enum class GoalResponse { REJECT, ACCEPT_AND_EXECUTE, ACCEPT_AND_DEFER };
enum class CancelResponse { REJECT, ACCEPT };
enum class GoalState { EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED };

template <typename Action>
class ServerGoalHandle {
public:
    explicit ServerGoalHandle(std::shared_ptr<const typename Action::Goal> goal) : goal_(std::move(goal)) {}
    [[nodiscard]] std::shared_ptr<const typename Action::Goal> get_goal() const { return goal_; }
    [[nodiscard]] bool is_canceling() const { return state == GoalState::CANCELING; }
    void publish_feedback(std::shared_ptr<typename Action::Feedback> message) { feedback = std::move(message); }
    void succeed(std::shared_ptr<typename Action::Result> message) { end(GoalState::SUCCEEDED, message); }
    void abort(std::shared_ptr<typename Action::Result> message) { end(GoalState::ABORTED, message); }
    void canceled(std::shared_ptr<typename Action::Result> message) {
        if (state != GoalState::CANCELING) {
            throw std::runtime_error("canceled without a cancel request");
        }
        end(GoalState::CANCELED, message);
    }

    GoalState state = GoalState::EXECUTING;
    std::shared_ptr<typename Action::Feedback> feedback;
    std::shared_ptr<typename Action::Result> result;

private:
    void end(GoalState last, std::shared_ptr<typename Action::Result> message) {
        if (result) {
            throw std::runtime_error("a goal has two results");
        }
        state = last;
        result = std::move(message);
    }
    std::shared_ptr<const typename Action::Goal> goal_;
};

template <typename Action>
class Server {
public:
    using Handle = ServerGoalHandle<Action>;
    std::string name;
    std::function<GoalResponse(const GoalUUID &, std::shared_ptr<const typename Action::Goal>)> handle_goal;
    std::function<CancelResponse(std::shared_ptr<Handle>)> handle_cancel;
    std::function<void(std::shared_ptr<Handle>)> handle_accepted;

    // A client's goal; null if it is rejected.
    std::shared_ptr<Handle> goal(const typename Action::Goal &goal) {
        const auto copy = std::make_shared<const typename Action::Goal>(goal);
        if (handle_goal({}, copy) == GoalResponse::REJECT) {
            return nullptr;
        }
        auto handle = std::make_shared<Handle>(copy);
        handle_accepted(handle);
        return handle;
    }
    // A client's cancel request.
    bool cancel(const std::shared_ptr<Handle> &handle) {
        if (handle->result || handle_cancel(handle) == CancelResponse::REJECT) {
            return false;
        }
        handle->state = GoalState::CANCELING;
        return true;
    }
};

template <typename Action, typename Node>
std::shared_ptr<Server<Action>> create_server(
    Node node, const std::string &name,
    std::function<GoalResponse(const GoalUUID &, std::shared_ptr<const typename Action::Goal>)> handle_goal,
    std::function<CancelResponse(std::shared_ptr<ServerGoalHandle<Action>>)> handle_cancel,
    std::function<void(std::shared_ptr<ServerGoalHandle<Action>>)> handle_accepted) {
    auto server = std::make_shared<Server<Action>>();
    server->name = name;
    server->handle_goal = std::move(handle_goal);
    server->handle_cancel = std::move(handle_cancel);
    server->handle_accepted = std::move(handle_accepted);
    node->server = server;
    return server;
}
}  // namespace rclcpp_action
