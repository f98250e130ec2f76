"""Plausibility of identified parameters and of the torques that they predict."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Articulated

from .identification import Identification
from .signals import Signals

USELESS, POOR = 1.0, 0.2
"""An error of the predicted torque, as a share of the torque's standard deviation: refused, and warned of."""

NOISE_ALONE = 0.6
"""A share of noise in a torque above which nothing else can be explained."""

SMALL = 5e-3
"""A share of the torque limit below which a torque shows nothing."""

SLUGGISH = 2.0
"""Seconds at the torque limit within which a rotor reaches its speed limit in any arm."""

OVERLOAD = 3.0
"""A torque, as a multiple of its limit, that no drive has."""

SURE = 2.0
"""Standard errors by which a parameter must be beyond a bound."""


def judge_result(result: Identification, robot: Articulated, signals: Signals, ignored: np.ndarray) -> tuple[str, ...]:
    """Sentences on what the log supports badly.

    - `result`: the identification.
    - `robot`: the arm as it was known.
    - `ignored`: True for joints whose torques were not used [n].

    Raises DefinitionError if a parameter is one that no such arm has, or the prediction errs by more than the torque.
    """
    warnings: list[str] = []
    _judge_parameters(result, robot, warnings)
    _judge_prediction(result, robot, signals, ignored, warnings)
    largest = np.abs(result.log.tau).max(axis=0)
    limit = np.asarray(robot.limits.torque)
    for joint in np.nonzero((largest > 1.2 * limit) & ~ignored)[0]:
        warnings.append(
            f"the torque of joint `{robot.joint_names[joint]}` reaches {largest[joint]:.4g}, "
            f"{largest[joint] / limit[joint]:.2g} times its limit in the arm's file"
        )
    if result.unseen:
        names = ", ".join(f"`{parameter.title}`" for parameter in result.unseen[:4])
        more = f" and {len(result.unseen) - 4} more" if len(result.unseen) > 4 else ""
        warnings.append(f"the log does not show {names}{more}: their values are those that were believed before")
    return tuple(warnings)


def _judge_prediction(
    result: Identification, robot: Articulated, signals: Signals, ignored: np.ndarray, warnings: list[str]
) -> None:
    inner = signals.inner
    size = np.std(result.measured[inner], axis=0) + 1e-12
    errors = np.maximum(result.fit_rms, result.held_out_rms)
    share = errors / size
    limit = np.asarray(robot.limits.torque)
    silent = (
        (signals.torque_noise() > NOISE_ALONE * size) | (np.isfinite(limit) & (size < SMALL * limit)) | (size < 1e-9)
    )
    for joint, name in enumerate(robot.joint_names):
        if ignored[joint] or share[joint] <= POOR:
            continue
        if silent[joint]:
            warnings.append(f"the torque of joint `{name}` is noise alone: the log shows nothing of its drive")
            continue
        where = "held out" if result.held_out_rms[joint] >= result.fit_rms[joint] else "fitted"
        facts = (
            f"{robot.name} as identified from {result.log.source} predicts the torque of joint `{name}` with an error "
            f"of {errors[joint]:.3g} in the part that is {where}; the torque itself varies by {size[joint]:.3g}"
        )
        if share[joint] > USELESS:
            raise DefinitionError(
                f"{facts}. No other sign, scale, joint order, delay or gravity explains it. Is the arm's file right, "
                f"and did nothing touch the arm? `--links` identifies its links, too; `--ignore-torque {name}` leaves "
                "this torque out"
            )
        warnings.append(f"{facts}: the arm's file, or this torque, is in doubt")


def _judge_parameters(result: Identification, robot: Articulated, warnings: list[str]) -> None:
    torque, speed = np.asarray(robot.limits.torque), np.asarray(robot.limits.velocity)
    reach = np.linalg.norm(np.asarray(robot.translations), axis=1).sum() + 0.1
    total = float(np.sum(robot.masses))
    joints = {name: number for number, name in enumerate(robot.joint_names)}
    believed = dict(zip(robot.joint_names, np.asarray(robot.masses), strict=True))
    for parameter in result.parameters:
        j = joints.get(parameter.joint, -1)
        bound, rule = np.inf, ""
        if parameter.name == "armature":
            if np.isfinite(torque[j]) and np.isfinite(speed[j]):
                bound = SLUGGISH * torque[j] / speed[j]
                rule = f"its drive would take more than {SLUGGISH:g} s to its speed limit"
            else:
                bound, rule = (
                    5.0 * total * (reach**2 if robot.joint_units[j] == "rad" else 1.0),
                    ("this is more than five times the whole arm stretched out"),
                )
        elif parameter.name == "coulomb" and np.isfinite(torque[j]):
            bound, rule = torque[j], "this is more than its drive's torque limit"
        elif parameter.name == "viscous" and np.isfinite(torque[j]) and np.isfinite(speed[j]):
            bound, rule = 3.0 * torque[j] / speed[j], "its drive could not reach its speed limit"
        elif parameter.name == "payload.mass":
            bound, rule = max(1.5 * total, 0.5), f"the arm itself weighs {total:.3g} kg"
        elif parameter.name == "link.mass":
            bound, rule = (
                10.0 * max(float(believed[parameter.joint]), 0.02 * total),
                "this is ten times the file's mass",
            )
        if parameter.value <= bound:
            continue
        half = 1.96 * parameter.standard_error
        facts = f"{parameter.title} would be {parameter.value:.4g} ± {half:.2g} {parameter.unit}"
        if parameter.value - SURE * parameter.standard_error > bound:
            raise DefinitionError(
                f"{facts}: {rule}. Torques or times of {result.log.source} are in another unit, scale or joint order "
                f"than those of {robot.name}: `--torque-unit`, `--torque-scale`, `--time-unit` and `--joint-order` set "
                "them"
            )
        warnings.append(f"{facts}: {rule}; the log does not tell it better")
