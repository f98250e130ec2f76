// In place of libfranka's header of this name: the scenario's arm behind the robot's rules.
//
// FAULT=nan measures NaN from 1.5 s on, FAULT=one-nan once; FAULT=gap tells nothing for 25 ms, FAULT=push pushes joint 4
// with 20 N m from there on. As the robot does, it ends a motion whose torque changes by more than 1 N m in 1 ms.
#pragma once
#include "active_control_base.h"
#include "exception.h"

#include "slidax_law_scenario.h"

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>

namespace franka {
class Arm : public ActiveControlBase {
public:
    Arm() {
        slidax_law_start(&plant_);
        const char *fault = std::getenv("FAULT");
        fault_ = fault == nullptr ? "" : fault;
    }

    RobotState state() const {
        slidax_law_measurement measured{};
        slidax_law_measure(&plant_, &measured);
        RobotState found;
        for (std::size_t i = 0; i < 7; ++i) {
            found.q[i] = measured.q[i];
            found.dq[i] = measured.dq[i];
        }
        found.control_command_success_rate = 1.0;
        return found;
    }

    std::pair<RobotState, Duration> readOnce() override {
        RobotState found = state();
        std::uint64_t elapsed = period_ == 0 ? 0 : 1;
        if (fault_ == "one-nan" ? period_ == 1500 : fault_ == "nan" && period_ >= 1500) {
            found.q[0] = std::nan("");
        }
        if (fault_ == "gap" && period_ == 1500) {
            elapsed = 25;
        }
        ++period_;
        return {found, Duration(elapsed)};
    }

    void writeOnce(const Torques &command) override {
        std::array<double, 7> tau = command.tau_J;
        for (std::size_t i = 0; i < 7; ++i) {
            if (!(std::fabs(tau[i] - last_[i]) <= 1.0)) {
                throw ControlException("controller_torque_discontinuity");
            }
        }
        last_ = tau;
        if (fault_ == "push" && period_ > 1500) {
            tau[3] += 20.0;
        }
        slidax_law_move(&plant_, SLIDAX_LAW_PERIOD, tau.data());
    }

private:
    slidax_law_plant plant_{};
    std::array<double, 7> last_{};
    long period_ = 0;
    std::string fault_;
};

class Robot {
public:
    explicit Robot(const std::string &address, RealtimeConfig /*realtime*/ = RealtimeConfig::kEnforce) {
        if (address == "nowhere") {
            throw NetworkException("no answer from nowhere");
        }
    }
    RobotState readOnce() { return Arm().state(); }
    std::unique_ptr<ActiveControlBase> startTorqueControl() { return std::make_unique<Arm>(); }
    void stop() {}
    void setCollisionBehavior(const std::array<double, 7> &, const std::array<double, 7> &,
                              const std::array<double, 6> &, const std::array<double, 6> &) {}
    void setLoad(double, const std::array<double, 3> &, const std::array<double, 9> &) {}
};
}  // namespace franka
