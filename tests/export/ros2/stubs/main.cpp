// The exported controller through its life, on the scenario's arm. Prints one line for each thing that is shown.
#include "rig.hpp"

using namespace rig;  // NOLINT: a test

namespace {
// The largest error of so many periods; -1 if an update ends with an error.
double moved(controller_interface::ControllerInterface &controller, int periods) {
    double largest = 0.0;
    for (int k = 0; k < periods; ++k) {
        measure();
        if (controller.update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            return -1.0;
        }
        slidax_law_move(&plant, SLIDAX_LAW_PERIOD, tau.data());
        const auto &told = controller.get_node()->publisher->sent.back();
        for (const auto &dimension : told.layout.dim) {
            if (dimension.label == "error") {
                for (std::size_t i = 0; i < kJoints; ++i) {
                    largest = std::fmax(largest, std::fabs(told.data.at(dimension.stride + i)));
                }
            }
        }
    }
    return largest;
}

void said(const char *what, bool so) {
    std::printf("%s %d %s\n", what, so, rclcpp::last_error.c_str());
}

}  // namespace

int main() {
    auto controller = made_by_the_plugin();
    slidax_law_start(&plant);
    measure();
    std::printf("init %d\n", controller->on_init() == CallbackReturn::SUCCESS);
    std::printf("interfaces %zu %zu\n", controller->command_interface_configuration().names.size(),
                controller->state_interface_configuration().names.size());
    controller->rate = 500;
    said("wrong rate", controller->on_configure(kState) == CallbackReturn::ERROR);
    controller->rate = 1000;
    std::printf("configure %d\n", controller->on_configure(kState) == CallbackReturn::SUCCESS);
    lend(*controller, false);
    std::printf("an interface is missing %d\n", controller->on_activate(kState) == CallbackReturn::ERROR);
    lend(*controller);
    controller->state_interfaces_[0] = decltype(controller->state_interfaces_)::value_type(nullptr);
    said("no value", controller->on_activate(kState) == CallbackReturn::ERROR);
    lend(*controller);
    q[0] = std::nan("");
    said("no posture", controller->on_activate(kState) == CallbackReturn::ERROR);
    measure();
    std::printf("activate %d\n", controller->on_activate(kState) == CallbackReturn::SUCCESS);
    std::printf("hold %.2e\n", moved(*controller, 1500));
    std::vector<double> there = q;
    there[0] += 0.3;
    controller->get_node()->subscription->callback(to(there, 2));
    std::printf("trajectory %.2e\n", moved(*controller, 2500));
    measure();
    std::printf("there %.2e\n", std::fabs(q[0] - there[0]));
    auto with_finger = to(there, 2);
    with_finger.joint_names.insert(with_finger.joint_names.begin(), "finger");
    with_finger.points[0].positions.insert(with_finger.points[0].positions.begin(), 0.04);
    controller->get_node()->subscription->callback(with_finger);
    std::printf("finger: %s%s\n", rclcpp::last_warning.c_str(), rclcpp::last_error.empty() ? "" : " and refused");
    auto wrong = to(there, 2);
    wrong.joint_names[0] = "elbow";
    controller->get_node()->subscription->callback(wrong);
    std::printf("wrong name: %s\n", rclcpp::last_error.c_str());
    there[0] = std::nan("");
    controller->get_node()->subscription->callback(to(there, 1));
    std::printf("not finite: %s, %d\n", rclcpp::last_error.c_str(), moved(*controller, 100) >= 0.0);
    for (int k = 0; k < 20; ++k) {
        q[0] = std::nan("");
        if (controller->update({}, rclcpp::Duration::from_seconds(SLIDAX_LAW_PERIOD)) != return_type::OK) {
            std::printf("stopped after %d\n", k + 1);
            break;
        }
    }
    bool finite = true;
    for (const double value : tau) {
        finite = finite && std::isfinite(value);
    }
    std::printf("finite %d\n", finite);
    said("deactivate", controller->on_deactivate(kState) == CallbackReturn::SUCCESS);
    measure();
    std::printf("again %d\n", controller->on_activate(kState) == CallbackReturn::SUCCESS && moved(*controller, 200) >= 0);
    std::printf("error %d\n", controller->on_error(kState) == CallbackReturn::SUCCESS);
    std::printf("configure again %d\n", controller->on_configure(kState) == CallbackReturn::SUCCESS);
    std::printf("cleanup %d\n", controller->on_cleanup(kState) == CallbackReturn::SUCCESS);
    std::printf("shutdown %d\n", controller->on_shutdown(kState) == CallbackReturn::SUCCESS);
    return 0;
}
