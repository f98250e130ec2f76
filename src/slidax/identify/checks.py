"""Checks of measured torques against the arm, and of the identified parameters."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.core.joint_names import joint_label

from .identified_arm import Identification, LogFit
from .log_checks import TRAVEL
from .logs import Conventions, JointLog
from .regression import ParameterFit
from .repairs import (
    Repair,
    joint_list,
    joint_orders,
    mountings,
    position_signs,
    position_units,
    position_zeros,
    torque_delays,
    torque_orders,
    torque_scales,
    torque_signs,
)
from .signals import LogSignals
from .torque_model import TorqueMatch, TorqueSample, match_torques, rigid_torques, sample_of
from .unknowns import Unknowns, mark_moving

DOUBT, COSTS = 0.1, 10.0
"""Other conventions are tried if a residual, as a share of the torque, or the prior's cost per joint exceeds these."""

BETTER = 0.7
"""Least decrease of the score, a sum of the residuals' logarithms, by another convention; 0.7 is a factor of two."""

SHARE_LEFT = 0.65
"""Largest score that a convincing convention may have, as a share of the score with the present conventions."""

EXPLAINS = 0.6
"""Least share of the torque's power that a convincing convention must explain."""

CLOSE = 0.4
"""Difference of scores within which two conventions fit equally well."""

LARGEST = 1e8
"""Torque that no arm reaches in any unit, N m."""

ENOUGH = 0.03
"""Share of the present score below which a convention is so good that no further ones are tried."""


def require_torques(
    log: JointLog,
    robot: Articulated,
    signals: LogSignals,
    usable: np.ndarray,
    conventions: Conventions,
) -> None:
    """Raise a DefinitionError if the log's torques fit the arm badly, but well by another convention.

    Conventions are units, signs, the joint order, zeros of positions, the mounting, and a delay of the torques.

    The message names the option that corrects the log.

    - `log`: the log in the arm's units and joint order, as far as known.
    - `signals`: the log's signals, low-pass filtered to a few Hz.
    - `usable`: True for joints whose torques are used [n].
    - `conventions`: units, signs and joint order that were already applied to the log.
    """
    sample = torque_sample(signals, usable)
    match = match_torques(robot, sample)
    doubtful = (match.errors > DOUBT) & (sample.floor < 0.7 * match.errors)
    if not doubtful.any() and match.cost < COSTS * robot.joints:
        return
    repairs = _repairs(robot, signals, sample, match, conventions)
    convincing = [
        repair
        for repair in repairs
        if repair.score < match.score - BETTER
        and repair.match.score < SHARE_LEFT * match.score
        and repair.match.explained > EXPLAINS
    ]
    if not convincing:
        return
    best = convincing[0]
    worst = int(np.argmax(match.errors))
    second = next((r for r in convincing[1:] if r.option.split()[0] != best.option.split()[0]), None)
    other = ""
    if second is not None and second.score < best.score + CLOSE:
        other = f"; {second.sentence} would fit as well: `{second.option}`"
    raise DefinitionError(
        f"torques of {log.source} do not fit {robot.name}: its links and drives explain "
        f"{100 * match.explained:.0f} % of them (least for {joint_label(robot.joint_names[worst])}). They explain "
        f"{100 * best.match.explained:.0f} % with {best.sentence}: `{best.option}` applies this{other}"
    )


def torque_sample(signals: LogSignals, usable: np.ndarray) -> TorqueSample:
    """Return a log's motion and torques at up to 240 times, without the equations of unused joints.

    - `signals`: the log's signals.
    - `usable`: True for joints whose torques are used [n].
    """
    sample = sample_of(signals, mark_moving(signals))
    return replace(sample, counts=sample.counts & usable)


def find_usable_torques(log: JointLog, robot: Articulated, conventions: Conventions) -> tuple[np.ndarray, list[str]]:
    """Return True for each joint whose torque was measured and is used [n], and warnings.

    Raises DefinitionError if a torque is impossibly large, or is constant although the joint moves, or if no torque is
    left to use.
    """
    largest = np.abs(log.tau).max(axis=0)
    if largest.max() > LARGEST:
        raise DefinitionError(
            f"the torque of {log.source} reaches {largest.max():.4g} N m for joint "
            f"`{log.joints[int(np.argmax(largest))]}`: no arm has such torques. Is this column a torque? `--columns` "
            "chooses the columns"
        )
    usable = np.array([name not in conventions.ignore_torque for name in log.joints])
    constant = usable & (np.ptp(log.tau, axis=0) <= 1e-9 * (np.abs(log.tau).max(axis=0) + 1e-9))
    if not usable.any():
        raise DefinitionError("`--ignore-torque` names all joints: nothing can be identified without a torque")
    if not constant.any():
        return usable, []
    if (constant == usable).all():
        value = "all 0" if not log.tau[:, constant].any() else "constant in each joint"
        raise DefinitionError(
            f"the torques of {log.source} are {value}: the robot's driver does not measure them, so nothing can be "
            "identified from this log; record a log with torques or motor currents (`--torque-scale` takes the "
            "torque in N m per unit of current)"
        )
    travels = np.ptp(log.q, axis=0) > np.array([TRAVEL[unit] for unit in robot.joint_units])
    wrong = [name for name, is_wrong in zip(log.joints, constant & travels, strict=True) if is_wrong]
    if wrong:
        listed = " ".join(f"--ignore-torque {name}" for name in wrong)
        raise DefinitionError(
            f"the torque of {log.source} is constant, {log.tau[0, log.joints.index(wrong[0])]:.4g}, for joint "
            f"`{wrong[0]}`, although the joint moves. Was this torque measured? `{listed}` leaves it out"
        )
    return usable & ~constant, [
        f"the torque of {log.source} is constant at standstill, as with a brake: it is left out for "
        f"{joint_list(robot, constant)}"
    ]


def _repairs(
    robot: Articulated, signals: LogSignals, sample: TorqueSample, match: TorqueMatch, conventions: Conventions
) -> list[Repair]:
    """Return other conventions with their matches, lowest score first.

    The search ends after the first stage with a convention that explains nearly all of the torque.
    """
    rigid = rigid_torques(robot, sample.motion)
    stages: tuple[Callable[[], Iterator[Repair]], ...] = (
        lambda: itertools.chain(
            torque_signs(robot, rigid, sample, conventions), position_signs(robot, sample, conventions)
        ),
        lambda: itertools.chain(torque_scales(robot, rigid, sample, conventions), position_units(robot, sample)),
        lambda: torque_orders(robot, rigid, sample, conventions),
        # For a planar arm, a different zero of the first joint and a tilted mounting look the same: try both.
        lambda: itertools.chain(position_zeros(robot, sample, conventions), mountings(robot, sample)),
        lambda: torque_delays(signals, rigid, sample, conventions),
        lambda: joint_orders(robot, sample, conventions),
    )
    repairs: list[Repair] = []
    for stage in stages:
        repairs += stage()
        if any(repair.match.score < ENOUGH * match.score for repair in repairs):
            break
    return sorted(repairs, key=lambda repair: repair.score)


USELESS, POOR = 1.0, 0.2
"""Error of the predicted torque, as a share of the torque's standard deviation, above which the result is refused, or
gets a warning."""

NOISE_ALONE = 0.6
"""Noise of a torque, as a share of the torque's standard deviation, above which the torque counts as noise alone."""

SMALL = 5e-3
"""Standard deviation of a torque, as a share of the torque limit, below which the torque counts as noise alone."""

SLUGGISH = 2.0
"""Longest time for a rotor alone to reach its speed limit at the torque limit, in any arm, s."""

SURE = 2.0
"""Number of standard errors by which a parameter must exceed its bound to be refused."""

CERTAIN = 3.0
"""Number of standard errors by which a prediction may miss the torque. Two are too few, since all joints must pass."""


def judge_result(
    result: Identification,
    robot: Articulated,
    signals: Sequence[LogSignals],
    unknowns: Sequence[Unknowns],
    fitted: ParameterFit,
    ignored: Sequence[np.ndarray],
) -> tuple[str, ...]:
    """Check the identified parameters and the predicted torques, and return warnings.

    - `result`: the identification.
    - `robot`: the arm before identification.
    - `signals`, `unknowns`: the signals and the torque equation of each log.
    - `fitted`: the least-squares fit before the bodies are made physically consistent.
    - `ignored`: for each log, True for joints whose torques were not used [n].

    Raises DefinitionError if a parameter is impossible for such an arm, or the prediction error exceeds the torque.
    """
    warnings: list[str] = []
    _judge_parameters(result, robot, warnings)
    limit = np.asarray(robot.limits.torque)
    for fit, own, each, sigma, unused in zip(result.logs, signals, unknowns, fitted.sigma, ignored, strict=True):
        _judge_prediction(fit, robot, own, each, fitted.covariance, sigma, unused, warnings)
        largest = np.abs(fit.log.tau).max(axis=0)
        for joint in np.nonzero((largest > 1.2 * limit) & ~unused)[0]:
            name = joint_label(robot.joint_names[joint])
            warnings.append(
                f"the torque of {fit.log.source} reaches {largest[joint]:.4g} for {name}, "
                f"{largest[joint] / limit[joint]:.2g} times its limit in the arm's file"
            )
    shows, does_not = ("log shows", "log does not") if len(result.logs) == 1 else ("logs show", "logs do not")
    poorly = [f"`{parameter.label}`" for parameter in result.unseen if parameter.is_poorly_seen]
    if poorly:
        warnings.append(f"the {shows} {_some(poorly)} poorly: trust the interval, not the value")
    hidden = [f"`{parameter.label}`" for parameter in result.unseen if not parameter.is_poorly_seen]
    if hidden:
        warnings.append(f"the {does_not} show {_some(hidden)}: the value stays near its prior")
    return tuple(warnings)


def _some(labels: Sequence[str]) -> str:
    more = f" and {len(labels) - 4} more" if len(labels) > 4 else ""
    return f"{', '.join(labels[:4])}{more}"


def _judge_prediction(
    fit: LogFit,
    robot: Articulated,
    signals: LogSignals,
    unknowns: Unknowns,
    covariance: np.ndarray,
    sigma: np.ndarray,
    ignored: np.ndarray,
    warnings: list[str],
) -> None:
    inner = signals.inner
    size = np.std(fit.measured[inner], axis=0) + 1e-12
    errors = np.maximum(fit.fit_rms, fit.held_out_rms)
    share = errors / size
    limit = np.asarray(robot.limits.torque)
    silent = (
        (signals.torque_noise() > NOISE_ALONE * size) | (np.isfinite(limit) & (size < SMALL * limit)) | (size < 1e-9)
    )
    for joint, name in enumerate(robot.joint_names):
        if ignored[joint] or share[joint] <= POOR:
            continue
        if silent[joint]:
            warnings.append(
                f"the torque of {fit.log.source} is only noise for joint `{name}`: this drive cannot be identified"
            )
            continue
        held_out = fit.held_out_rms[joint] >= fit.fit_rms[joint]
        facts = (
            f"{robot.name} as identified from {fit.log.source} predicts the torque of joint `{name}` with an error "
            f"of {errors[joint]:.3g} in the {'held-out' if held_out else 'fitted'} part; the torque itself varies by "
            f"{size[joint]:.3g}"
        )
        if share[joint] <= USELESS:
            warnings.append(f"{facts}: the arm's file or this torque may be wrong")
            continue
        rows = inner & ((np.arange(len(inner)) >= fit.split) == held_out)
        columns = signals.filtered(unknowns.columns[:, joint])[rows]
        unsure = CERTAIN * float(np.sqrt(np.mean(columns @ covariance * columns) * columns.shape[1]))
        explained = sigma[joint] < 0.5 * size[joint]
        if not explained or errors[joint] > USELESS * np.hypot(size[joint], unsure):
            raise DefinitionError(
                f"{facts}. No other sign, scale, joint order, delay or gravity explains it. Is the arm's file right, "
                f"and did nothing touch the arm? `--links` also identifies its links; `--ignore-torque {name}` leaves "
                "this torque out"
            )
        warnings.append(
            f"{facts}. The fitted part leaves this torque uncertain by {unsure:.3g}: the log is too short, too slow or "
            "too noisy to predict it, and the intervals are wide"
        )


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
                rule = f"its drive would take more than {SLUGGISH:g} s to reach its speed limit"
            else:
                bound, rule = (
                    5.0 * total * (reach**2 if robot.joint_units[j] == "rad" else 1.0),
                    "this is more than five times the inertia of the stretched arm",
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
                "this is more than ten times the mass in the arm's file",
            )
        if parameter.value <= bound:
            continue
        half = 1.96 * parameter.standard_error
        facts = f"{parameter.label} would be {parameter.value:.4g} ± {half:.2g} {parameter.unit}"
        if parameter.value - SURE * parameter.standard_error > bound:
            raise DefinitionError(
                f"{facts}: {rule}. Torques or times of {result.source} are in another unit, scale or joint order "
                f"than those of {robot.name}: `--torque-unit`, `--torque-scale`, `--time-unit` and `--joint-order` set "
                "them"
            )
        warnings.append(f"{facts}: {rule}; the log determines it poorly")
