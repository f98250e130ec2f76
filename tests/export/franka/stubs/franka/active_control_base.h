// In place of libfranka's header of this name.
#pragma once
#include "control_types.h"
#include "duration.h"
#include "robot_state.h"

#include <utility>

namespace franka {
class ActiveControlBase {
public:
    virtual ~ActiveControlBase() = default;
    virtual std::pair<RobotState, Duration> readOnce() = 0;
    virtual void writeOnce(const Torques &command) = 0;
};
}  // namespace franka
