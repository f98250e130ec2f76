"""Torque limits of a MuJoCo model's joints."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from slidax._errors import DefinitionError

from .loader import mujoco


def geared(model: Any, joint: int) -> list[int]:
    """Return the indices of the actuators that drive a joint."""
    kinds = mujoco().mjtTrn
    direct = (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
    return [i for i in range(model.nu) if model.actuator_trntype[i] in direct and model.actuator_trnid[i, 0] == joint]


def torque_limits(model: Any) -> np.ndarray:
    """Return the torque limit of each joint, the same in both directions, N m or N; infinite where none is given.

    Raises DefinitionError, naming the joint, if its range does not contain both directions.
    """
    limits = []
    for joint in range(model.njnt):
        lower, upper = _by_actuators(model, joint)
        if model.jnt_actfrclimited[joint]:
            low, high = (float(end) for end in model.jnt_actfrcrange[joint])
            lower, upper = max(lower, low), min(upper, high)
        if not lower < 0.0 < upper:
            raise DefinitionError(
                f"the torque of joint `{model.joint(joint).name}` must go both ways; its range is {lower:g} to "
                f"{upper:g}"
            )
        limits.append(min(-lower, upper))
    return np.array(limits)


def _by_actuators(model: Any, joint: int) -> tuple[float, float]:
    """Sum of the ranges of a joint's actuators; unlimited without any, since a law's torque acts all the same."""
    ranges = [_range(model, actuator) for actuator in geared(model, joint)]
    if not ranges:
        return -math.inf, math.inf
    return sum(low for low, _ in ranges), sum(high for _, high in ranges)


def _range(model: Any, actuator: int) -> tuple[float, float]:
    library, gear = mujoco(), float(model.actuator_gear[actuator, 0])
    low, high = -math.inf, math.inf
    if model.actuator_forcelimited[actuator]:
        low, high = (float(end) for end in model.actuator_forcerange[actuator])
    motor = (
        model.actuator_gaintype[actuator] == int(library.mjtGain.mjGAIN_FIXED)
        and model.actuator_biastype[actuator] == int(library.mjtBias.mjBIAS_NONE)
        and model.actuator_dyntype[actuator] == int(library.mjtDyn.mjDYN_NONE)
    )
    if motor and model.actuator_ctrllimited[actuator]:
        gain = float(model.actuator_gainprm[actuator, 0])
        ends = sorted(gain * float(end) for end in model.actuator_ctrlrange[actuator])
        low, high = max(low, ends[0]), min(high, ends[1])
    if gear == 0.0:
        return 0.0, 0.0
    first, last = sorted((gear * low, gear * high))
    return first, last
