"""Torques of a log against the arm: other conventions are tried where they contradict it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Articulated

from .conventions import Conventions
from .log import Log
from .motion_checks import TRAVEL
from .motion_repairs import joint_orders, mountings, position_signs, position_units, position_zeros
from .repair import Repair, named
from .sample import Sample, sample_of
from .signals import Signals
from .torque_model import Match, matched, rigid_torques
from .torque_repairs import torque_delays, torque_orders, torque_scales, torque_signs
from .unknowns import moving

DOUBT, COSTS = 0.1, 10.0
"""A residual, as a share of the torque, and a cost of the belief per joint: above, other conventions are tried."""

BETTER = 0.7
"""By how much the sum of the logarithms of the residuals must fall for another convention: a factor of two."""

SHARE_LEFT = 0.65
"""Of that sum, which another convention may leave."""

EXPLAINS = 0.6
"""The share of the torque's power that another convention must explain."""

CLOSE = 0.4
"""A difference of scores within which two conventions fit equally well."""

LARGEST = 1e8
"""A torque that no arm has, N m, in whatever unit."""

ENOUGH = 0.03
"""The share of the score that a convention leaves, below which no further ones are tried."""


def require_torques(
    log: Log,
    robot: Articulated,
    signals: Signals,
    usable: np.ndarray,
    conventions: Conventions,
) -> None:
    """Raise a DefinitionError if the torques contradict the arm and fit it with another convention.

    - `log`: in the arm's units and joint order, as far as known.
    - `signals`: of the log, in a band of a few Hz.
    - `usable`: True for joints whose torques are used [n].
    """
    sample = sample_of(signals, moving(signals))
    sample = replace(sample, counts=sample.counts & usable)
    match = matched(robot, sample)
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
        f"torques of {log.source} do not fit {robot.name}, of whose links and drives they show "
        f"{100 * match.explained:.0f} % (least of joint `{robot.joint_names[worst]}`). They fit it to "
        f"{100 * best.match.explained:.0f} % with {best.sentence}: `{best.option}` applies this{other}"
    )


def usable_torques(log: Log, robot: Articulated, conventions: Conventions) -> tuple[np.ndarray, list[str]]:
    """True for each joint whose torque was measured and is used [n]; and warnings.

    Raises DefinitionError if the torque of a joint that moves is constant, or all torques are.
    """
    largest = np.abs(log.tau).max(axis=0)
    if largest.max() > LARGEST:
        raise DefinitionError(
            f"the torque of {log.source} reaches {largest.max():.4g} N m for joint "
            f"`{log.joints[int(np.argmax(largest))]}`: no arm has such torques; is this column a torque? `--columns` "
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
            f"the torques of {log.source} are {value}: its driver does not measure them, and so nothing can be "
            "identified from this log; record a log with torques or motor currents (`--torque-scale` takes their "
            "N m per unit)"
        )
    travels = np.ptp(log.q, axis=0) > np.array([TRAVEL[unit] for unit in robot.joint_units])
    wrong = [name for name, is_wrong in zip(log.joints, constant & travels, strict=True) if is_wrong]
    if wrong:
        listed = " ".join(f"--ignore-torque {name}" for name in wrong)
        raise DefinitionError(
            f"the torque of {log.source} is constant, {log.tau[0, log.joints.index(wrong[0])]:.4g}, for joint "
            f"`{wrong[0]}`, which moves: is it not measured? `{listed}` leaves it out"
        )
    return usable & ~constant, [
        f"the torque of {log.source} is constant for {named(robot, constant)}, which stand still, as with a brake: "
        "it is left out"
    ]


def _repairs(
    robot: Articulated, signals: Signals, sample: Sample, match: Match, conventions: Conventions
) -> list[Repair]:
    """Other conventions with their matches; the costly ones are left out after one that explains all."""
    rigid = rigid_torques(robot, sample.motion)
    stages: tuple[Callable[[], Iterator[Repair]], ...] = (
        lambda: itertools.chain(
            torque_signs(robot, rigid, sample, conventions), position_signs(robot, sample, conventions)
        ),
        lambda: itertools.chain(torque_scales(robot, rigid, sample, conventions), position_units(robot, sample)),
        lambda: torque_orders(robot, rigid, sample, conventions),
        # For an arm in a plane, another zero of its first joint is another direction of gravity: both are named.
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
