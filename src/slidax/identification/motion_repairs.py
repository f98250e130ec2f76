"""Other joint orders, directions, zeros and units of a log's positions, and other mountings of the arm."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from scipy import optimize

from slidax.robots import Articulated

from .conventions import Conventions
from .motion_checks import DEGREE
from .repair import EACH, Repair, exchanges, flips, improved, listed, named, order_option, same_or_listed
from .sample import Sample
from .torque_model import Match, drive_columns, matched, nonnegative, rigid_torques, with_gravity

FEW = 4
"""Joints of which all orders are tried; of more, exchanges of two as long as the match gets better."""

STEPS = 12
"""Positions of another zero that are tried in a turn."""


def position_signs(robot: Articulated, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Joints that the log counts in the opposite direction."""
    n = robot.joints
    same = np.arange(n)
    ones, zero = np.ones(n), np.zeros(n)
    for start in (ones, -ones):
        sign, match = improved(start, lambda sign: matched(robot, sample.with_positions(same, sign, zero)), flips)
        if (sign < 0).any():
            yield Repair(
                f"the opposite direction of the positions of {named(robot, sign < 0)}",
                f"--position-sign {same_or_listed(sign * conventions.each('position_sign', n))}",
                2 if (sign < 0).all() else 1 + int((sign < 0).sum()),
                match,
            )


def joint_orders(robot: Articulated, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Positions in another joint order, with their torques or without."""
    n = robot.joints
    ones, zero = np.ones(n), np.zeros(n)

    def match_both(order: np.ndarray) -> Match:
        return matched(robot, sample.with_positions(order, ones, zero).with_torques(order, ones))

    def match_positions(order: np.ndarray) -> Match:
        return matched(robot, sample.with_positions(order, ones, zero))

    for match_of, option, earlier, columns in (
        (match_both, "--joint-order", conventions.joint_order, "positions and torques"),
        (match_positions, "--position-order", conventions.position_order, "positions"),
    ):
        if n <= FEW:
            tried = [(order, match_of(order)) for order in map(np.array, itertools.permutations(range(n)))]
        else:
            alphabetical = np.argsort(robot.joint_names)
            others = (np.arange(n)[::-1], alphabetical, np.argsort(alphabetical))
            tried = [improved(np.arange(n), match_of, exchanges)]
            tried += [(order, match_of(order)) for order in others]
        order, match = min(tried, key=lambda pair: pair[1].score)
        if (order != np.arange(n)).any():
            moved = order != np.arange(n)
            yield Repair(
                f"the {columns} of {named(robot, moved)} interchanged",
                f"{option} {order_option(robot, order, earlier)}",
                int(moved.sum()),
                match,
            )


def position_units(robot: Articulated, sample: Sample) -> Iterator[Repair]:
    """Positions in degrees or revolutions."""
    turning = np.array([unit == "rad" for unit in robot.joint_units])
    largest = np.abs(sample.motion.q[:, turning]).max(initial=0.0)
    for size, name, unit, is_possible in (
        (DEGREE, "degrees", "deg", largest > 0.5),
        (2.0 * np.pi, "revolutions", "rev", 0.0 < largest < 1.0),
    ):
        if is_possible:
            factor = np.where(turning, size, 1.0)
            match = matched(robot, sample.with_positions(np.arange(robot.joints), factor, np.zeros(robot.joints)))
            yield Repair(f"positions in {name}", f"--position-unit {unit}", 1, match)


def position_zeros(robot: Articulated, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Positions with another zero."""
    n = robot.joints
    same, ones, zero = np.arange(n), np.ones(n), np.zeros(n)
    turning = np.array([unit == "rad" for unit in robot.joint_units])

    def match_of(offset: np.ndarray) -> Match:
        return matched(robot, sample.with_positions(same, ones, offset))

    def others(offset: np.ndarray) -> Iterator[np.ndarray]:
        for joint in np.nonzero(turning)[0]:
            for turn in np.arange(1, STEPS) * 2.0 * np.pi / STEPS:
                other = offset.copy()
                other[joint] = (offset[joint] + turn + np.pi) % (2.0 * np.pi) - np.pi
                yield other

    zeros, match = improved(zero, match_of, others)
    if not zeros.any():
        return
    for joint in np.nonzero(zeros)[0]:

        def along(value: float, joint: int = int(joint)) -> float:
            return match_of(np.where(np.arange(n) == joint, value, zeros)).score

        step = 2.0 * np.pi / STEPS
        near = (zeros[joint] - step, zeros[joint] + step)
        best = optimize.minimize_scalar(along, bounds=near, method="bounded", options={"maxiter": 15}).x
        quarter = 0.5 * np.pi * np.round(best / (0.5 * np.pi))
        # A zero is a matter of convention where it is about a quarter of a turn away.
        zeros[joint] = quarter if abs(best - quarter) < 0.1 and along(quarter) < along(best) + EACH else best
    match = match_of(zeros)
    total = zeros + conventions.each("position_offset", n)
    yield Repair(
        f"another zero of the positions of {named(robot, zeros != 0.0)}",
        f"--position-offset {listed(total, 5)}",
        2 * int((zeros != 0.0).sum()),
        match,
    )


def mountings(robot: Articulated, sample: Sample) -> Iterator[Repair]:
    """The direction of gravity that fits best, from three columns that are linear in it, then by its score."""
    believed = np.asarray(robot.gravity_vector)
    strength = float(np.linalg.norm(believed)) or 9.81

    def torque(gravity: np.ndarray) -> np.ndarray:
        return rigid_torques(with_gravity(robot, gravity), sample.motion).total

    still = torque(np.zeros(3))
    each = np.stack([torque(axis) - still for axis in np.eye(3)], axis=2)
    weight = sample.counts / sample.size
    whole = np.concatenate([each, -each, drive_columns(sample)], axis=2) * weight[:, :, None]
    a, b = whole.reshape(-1, whole.shape[2]), ((sample.tau - still) * weight).ravel()
    solution = nonnegative(a, b)
    # Along an axis that no joint feels, the columns are rounding.
    felt = np.linalg.norm(each, axis=(0, 1)) > 1e-6 * np.linalg.norm(each)
    direction = np.where(felt, solution[:3] - solution[3:6], 0.0)
    if not felt.any() or not direction.any():
        return

    def score(vector: np.ndarray) -> float:
        turned = strength * vector / (np.linalg.norm(vector) + 1e-12)
        return matched(with_gravity(robot, turned), sample).score

    yield Repair(
        "the arm's gravity added to them, as of a controller that compensates it by itself",
        "--add-gravity",
        1,
        matched(with_gravity(robot, np.zeros(3)), sample),
    )
    around = [np.array(signs) * felt for signs in itertools.product((-1.0, 0.0, 1.0), repeat=3)]
    starts = [direction, *(vector for vector in around if vector.any())]
    start = min(starts, key=score)
    start = start / np.linalg.norm(start)
    best = optimize.minimize(score, start, method="Nelder-Mead", options={"maxfev": 80, "xatol": 1e-3})
    gravity = strength * best.x / np.linalg.norm(best.x)
    angle = float(np.degrees(np.arccos(np.clip(gravity @ believed / strength**2, -1.0, 1.0))))
    if angle > 3.0:
        yield Repair(
            f"gravity turned by {angle:.0f}°, for an arm that is mounted so",
            f"--gravity {listed(gravity, 4)}",
            2,
            matched(with_gravity(robot, gravity), sample),
        )
