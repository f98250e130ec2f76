// Positions that a host streams to the exported controller. Prints one line for each thing that is shown.
#include "rig.hpp"

using namespace rig;  // NOLINT: a test

namespace {
std::unique_ptr<controller_interface::ControllerInterface> controller;

double published(const char *name, std::size_t joint) {
    const auto &told = controller->get_node()->publisher->sent.back();
    for (const auto &dimension : told.layout.dim) {
        if (dimension.label == name) {
            return told.data.at(dimension.stride + joint);
        }
    }
    return std::nan("");
}

// The largest error and speed in so many periods; each `every` periods the host sends where it is.
template <typename Host>
void moved(const char *what, int periods, int every, const Host &host) {
    double error = 0.0;
    double speed = 0.0;
    bool ok = true;
    for (int k = 0; k < periods; ++k) {
        if (every > 0 && k % every == 0) {
            std_msgs::msg::Float64MultiArray message;
            message.data = host(k);
            controller->get_node()->positions->callback(message);
        }
        measure();
        ok = ok && controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) == return_type::OK;
        slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
        for (std::size_t i = 0; i < kJoints; ++i) {
            error = std::fmax(error, std::fabs(published("error", i)));
            speed = std::fmax(speed, std::fabs(dq[i]));
        }
    }
    measure();
    std::printf("%s %d %.4f %.4f %.4f %.4f phase %.0f\n", what, ok, error, speed, q[0], q[1], published("phase", 0));
}
}  // namespace

int main() {
    controller = made_by_the_plugin();
    slidax_law_start(&plant);
    measure();
    (void)controller->on_init();
    (void)controller->on_configure(kState);
    lend(*controller);
    const bool active = controller->on_activate(kState) == CallbackReturn::SUCCESS;
    const std::vector<double> start = q;
    const auto none = [&](int) { return start; };
    std::printf("active %d\n", active);
    moved("hold", 1100, 0, none);
    // At 50 Hz: a way of 0.4 rad in 2 s, then silence.
    moved("way", 2000, 20, [&](int k) { return std::vector<double>{start[0] + 0.2e-3 * k, start[1] - 0.1e-3 * k}; });
    moved("silence", 1500, 0, none);
    // At once to another place, and a trajectory in the middle.
    moved("jump", 300, 20, [&](int) { return start; });
    controller->get_node()->subscription->callback(to(start, 3));
    moved("trajectory", 3200, 0, none);
    std_msgs::msg::Float64MultiArray bad;
    bad.data = {std::nan(""), 0.0};
    controller->get_node()->positions->callback(bad);
    std::printf("bad: %s\n", rclcpp::last_error.c_str());
    moved("beyond", 4000, 20, [&](int) { return std::vector<double>{9.0, start[1]}; });
    return 0;
}
