"""Alternative conventions under which a log may fit its arm: signs, scales, orders, delays, zeros, mountings.

In the functions that yield `Repair`s, `sample` is the log's motion and torques at a few times, and `conventions` are
those that were already applied to the log.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from slidax.arms.articulated import Articulated

from .log_checks import DEGREE
from .logs import Conventions
from .signals import LogSignals
from .torque_model import (
    RigidTorques,
    TorqueMatch,
    TorqueSample,
    drive_columns,
    gravity_direction,
    match_rigid_torques,
    match_torques,
    nonnegative,
    with_gravity,
)

EACH = 0.15
"""The score that each changed joint costs, so that the simpler of two conventions is preferred."""


@dataclass(frozen=True, eq=False)
class Repair:
    """An alternative convention for a log.

    - `sentence`: description of the convention; it completes "They explain 99 % with ...".
    - `option`: the command-line option that applies it.
    - `joints`: number of joints that it changes.
    - `match`: match of the arm's torques under this convention.
    """

    sentence: str
    option: str
    joints: int
    match: TorqueMatch

    @property
    def score(self) -> float:
        """The match's score plus the cost of the changes; smaller is better."""
        return self.match.score + EACH * self.joints


def improve_entries(
    start: np.ndarray,
    match_of: Callable[[np.ndarray], TorqueMatch],
    others: Callable[[np.ndarray], Iterator[np.ndarray]],
) -> tuple[np.ndarray, TorqueMatch]:
    """Improve the signs or the order of joints by greedy search, and return them with their match.

    The search applies the best single change until the match no longer improves.

    - `start`: initial entries, such as each joint's sign [n].
    - `match_of`: returns the match of the arm's torques with the log's for such entries.
    - `others`: yields all entries that differ from its argument by a single change, as `flips` or `exchanges`.
    """
    best, match = start, match_of(start)
    for _ in range(len(start)):
        scored = [(match_of(other), other) for other in others(best)]
        candidate, other = min(scored, key=lambda pair: pair[0].score)
        if candidate.score > match.score - EACH:
            break
        best, match = other, candidate
    return best, match


def flips(sign: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the signs with a single sign changed, for each joint in turn."""
    for joint in range(len(sign)):
        other = sign.copy()
        other[joint] *= -1.0
        yield other


def exchanges(order: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the order with two entries exchanged, for each pair of joints."""
    for a, b in itertools.combinations(range(len(order)), 2):
        other = order.copy()
        other[[a, b]] = order[[b, a]]
        yield other


def order_option(robot: Articulated, order: np.ndarray, earlier: Sequence[str]) -> str:
    """Return the value of an option such as `--joint-order`, joint names separated by commas.

    For each column of the log as read, the name is that of the arm's joint whose values it has.

    - `order`: for each joint of the arm, the column with its values [n].
    - `earlier`: joint names of this option if it was already applied to the columns; empty otherwise.
    """
    names = list(robot.joint_names)
    belongs = {names[column]: names[joint] for joint, column in enumerate(order)}
    labels = list(earlier) or names
    return ",".join(belongs[label] for label in labels)


def joint_list(robot: Articulated, which: np.ndarray) -> str:
    """Return the names of the selected joints, for a message.

    - `which`: True for selected joints [n].
    """
    names = [f"`{name}`" for name, chosen in zip(robot.joint_names, which, strict=True) if chosen]
    return "all joints" if len(names) == robot.joints and len(names) > 1 else ", ".join(names)


def number_list(values: np.ndarray, digits: int = 3) -> str:
    """Return numbers separated by commas, as options take them.

    - `values`: the numbers.
    - `digits`: significant digits.
    """
    return ",".join(f"{value + 0.0:.{digits}g}" for value in values)


def short_number_list(values: np.ndarray) -> str:
    """Return a single number if all are equal; otherwise as `number_list`."""
    return number_list(values[:1] if (values == values[0]).all() else values)


FEW = 4
"""Up to this number of joints all orders are tried; for more joints a greedy search exchanges pairs."""

STEPS = 12
"""Number of zero positions to try per revolution."""


def position_signs(robot: Articulated, sample: TorqueSample, conventions: Conventions) -> Iterator[Repair]:
    """Yield alternative conventions: positions that the log counts in the opposite direction, in some joints or all."""
    n = robot.joints
    same = np.arange(n)
    ones, zero = np.ones(n), np.zeros(n)
    for start in (ones, -ones):
        sign, match = improve_entries(
            start, lambda sign: match_torques(robot, sample.with_positions(same, sign, zero)), flips
        )
        if (sign < 0).any():
            yield Repair(
                f"the opposite direction of the positions of {joint_list(robot, sign < 0)}",
                f"--position-sign {short_number_list(sign * conventions.each('position_sign', n))}",
                2 if (sign < 0).all() else 1 + int((sign < 0).sum()),
                match,
            )


def joint_orders(robot: Articulated, sample: TorqueSample, conventions: Conventions) -> Iterator[Repair]:
    """Yield alternative conventions: positions in another joint order, with their torques or without."""
    n = robot.joints
    ones, zero = np.ones(n), np.zeros(n)

    def match_both(order: np.ndarray) -> TorqueMatch:
        return match_torques(robot, sample.with_positions(order, ones, zero).with_torques(order, ones))

    def match_positions(order: np.ndarray) -> TorqueMatch:
        return match_torques(robot, sample.with_positions(order, ones, zero))

    for match_of, option, earlier, columns in (
        (match_both, "--joint-order", conventions.joint_order, "positions and torques"),
        (match_positions, "--position-order", conventions.position_order, "positions"),
    ):
        if n <= FEW:
            tried = [(order, match_of(order)) for order in map(np.array, itertools.permutations(range(n)))]
        else:
            alphabetical = np.argsort(robot.joint_names)
            others = (np.arange(n)[::-1], alphabetical, np.argsort(alphabetical))
            tried = [improve_entries(np.arange(n), match_of, exchanges)]
            tried += [(order, match_of(order)) for order in others]
        order, match = min(tried, key=lambda pair: pair[1].score)
        if (order != np.arange(n)).any():
            moved = order != np.arange(n)
            yield Repair(
                f"the {columns} of {joint_list(robot, moved)} interchanged",
                f"{option} {order_option(robot, order, earlier)}",
                int(moved.sum()),
                match,
            )


def position_units(robot: Articulated, sample: TorqueSample) -> Iterator[Repair]:
    """Yield alternative conventions: positions in degrees or revolutions."""
    turning = np.array([unit == "rad" for unit in robot.joint_units])
    largest = np.abs(sample.motion.q[:, turning]).max(initial=0.0)
    for size, name, unit, is_possible in (
        (DEGREE, "degrees", "deg", largest > 0.5),
        (2.0 * np.pi, "revolutions", "rev", 0.0 < largest < 1.0),
    ):
        if is_possible:
            factor = np.where(turning, size, 1.0)
            match = match_torques(robot, sample.with_positions(np.arange(robot.joints), factor, np.zeros(robot.joints)))
            yield Repair(f"positions in {name}", f"--position-unit {unit}", 1, match)


def position_zeros(robot: Articulated, sample: TorqueSample, conventions: Conventions) -> Iterator[Repair]:
    """Yield the alternative with other zeros of the positions, if one fits better."""
    n = robot.joints
    same, ones, zero = np.arange(n), np.ones(n), np.zeros(n)
    turning = np.array([unit == "rad" for unit in robot.joint_units])

    def match_of(offset: np.ndarray) -> TorqueMatch:
        return match_torques(robot, sample.with_positions(same, ones, offset))

    def others(offset: np.ndarray) -> Iterator[np.ndarray]:
        for joint in np.nonzero(turning)[0]:
            for angle in np.arange(1, STEPS) * 2.0 * np.pi / STEPS:
                other = offset.copy()
                other[joint] = (offset[joint] + angle + np.pi) % (2.0 * np.pi) - np.pi
                yield other

    zeros, match = improve_entries(zero, match_of, others)
    if not zeros.any():
        return
    for joint in np.nonzero(zeros)[0]:

        def along(value: float, joint: int = int(joint)) -> float:
            return match_of(np.where(np.arange(n) == joint, value, zeros)).score

        step = 2.0 * np.pi / STEPS
        near = (zeros[joint] - step, zeros[joint] + step)
        best = optimize.minimize_scalar(along, bounds=near, method="bounded", options={"maxiter": 15}).x
        quarter = 0.5 * np.pi * np.round(best / (0.5 * np.pi))
        # A zero that differs by about a multiple of 90° is a convention, and so differs by exactly this multiple.
        zeros[joint] = quarter if abs(best - quarter) < 0.1 and along(quarter) < along(best) + EACH else best
    match = match_of(zeros)
    total = zeros + conventions.each("position_offset", n)
    yield Repair(
        f"another zero of the positions of {joint_list(robot, zeros != 0.0)}",
        f"--position-offset {number_list(total, 5)}",
        2 * int((zeros != 0.0).sum()),
        match,
    )


def mountings(robot: Articulated, sample: TorqueSample) -> Iterator[Repair]:
    """Yield alternative conventions: torques without gravity, or gravity in the direction that fits best."""
    believed = np.asarray(robot.gravity_vector)
    strength = float(np.linalg.norm(believed)) or 9.81
    gravity = gravity_direction([robot], [sample])
    if gravity is None:
        return
    yield Repair(
        "the arm's gravity added to them, as for a robot that compensates gravity internally",
        "--add-gravity",
        1,
        match_torques(with_gravity(robot, np.zeros(3)), sample),
    )
    angle = float(np.degrees(np.arccos(np.clip(gravity @ believed / strength**2, -1.0, 1.0))))
    if angle > 3.0:
        yield Repair(
            f"gravity rotated by {angle:.0f}°, as for an arm mounted at this angle, which `--gravity identify` "
            "estimates with an interval",
            f"--gravity {number_list(gravity, 4)}",
            2,
            match_torques(with_gravity(robot, gravity), sample),
        )


SCALES = (0.4, 2.5)
"""Range of torque factors for which wrong masses are as likely a cause as a wrong scale."""

SHARES = (0.7, 1.4)
"""As `SCALES`, for single joints: the range is narrower, since the torques of the other joints determine the masses."""

UNITS = {1e3: "mN m", 1e2: "N cm", 1e-3: "kN m", 1.0 / 0.0980665: "kgf cm"}
"""Factor by which torques in other units are too large, and the unit's name."""

LATEST = 1.0
"""Largest torque delay to search for, s."""


def torque_signs(
    robot: Articulated, rigid: RigidTorques, sample: TorqueSample, conventions: Conventions
) -> Iterator[Repair]:
    """Yield alternative conventions: torques with the opposite sign, in all joints or in some.

    - `rigid`: torques of the arm's bodies.
    """
    n, same = robot.joints, np.arange(robot.joints)

    def match_of(sign: np.ndarray) -> TorqueMatch:
        return match_rigid_torques(rigid, sample.with_torques(same, sign))

    for start in (np.ones(n), -np.ones(n)):
        sign, match = improve_entries(start, match_of, flips)
        if (sign < 0).any():
            yield Repair(
                f"the opposite sign for {joint_list(robot, sign < 0)}",
                f"--torque-sign {short_number_list(sign * conventions.each('torque_sign', n))}",
                1 if (sign < 0).all() else int((sign < 0).sum()),
                match,
            )


def torque_scales(
    robot: Articulated, rigid: RigidTorques, sample: TorqueSample, conventions: Conventions
) -> Iterator[Repair]:
    """Yield alternative conventions: torques in another unit, motor currents, or torques at the motor's side of a gear.

    - `rigid`: torques of the arm's bodies.
    """
    n = robot.joints

    def repair(scales: np.ndarray, unit: str = "") -> Repair:
        match = match_rigid_torques(rigid, sample.with_torques(np.arange(n), 1.0 / scales))
        return _scaled(robot, scales, unit, match, conventions)

    for sign in (1.0, -1.0):
        rough = _scale_of(rigid, sample, sign)[0]
        if rough < 1e-9:
            continue
        # A payload and heavier links change the scale by less than a factor of three.
        best = optimize.minimize_scalar(
            lambda power, sign=sign: repair(np.full(n, sign * np.exp(power))).match.score,
            bounds=(np.log(rough / 3.0), np.log(rough * 3.0)),
            method="bounded",
            options={"maxiter": 14},
        )
        scale = float(np.exp(best.x))
        if not SCALES[0] < scale < SCALES[1]:
            yield repair(np.full(n, sign * scale))
        for factor, unit in UNITS.items():
            if 0.4 < rough / factor < 2.5:
                yield repair(np.full(n, sign * factor), unit)
    # A joint without a rigid-body torque shows no scale; it gets the median scale of the others.
    each = [_scale_of(rigid.only(j), sample.only(j, j)) for j in range(n)]
    scales = np.array([scale if shows else 0.0 for scale, shows in each])
    shown_scales = np.abs(scales[scales != 0.0])
    if not len(shown_scales):
        return
    outside = (scales != 0.0) & ((np.abs(scales) < SHARES[0]) | (np.abs(scales) > SHARES[1]))
    if not outside.any():
        return
    yield repair(np.where(scales == 0.0, np.median(shown_scales), scales))
    few = np.where(outside, scales, 1.0)
    yield repair(few)
    # Relative to the other joints, in case a payload makes all scales look larger.
    relative = scales / np.median(shown_scales)
    deviating = (scales != 0.0) & ((np.abs(relative) < SHARES[0]) | (np.abs(relative) > SHARES[1]))
    for joint in np.nonzero(outside)[0]:
        others = np.delete(np.abs(scales), joint)
        own = scales[joint] / np.median(others[others > 0.0]) if (others > 0.0).any() else scales[joint]
        yield repair(np.where(np.arange(n) == joint, own, 1.0))
    if deviating.any():
        yield repair(np.where(deviating, relative, 1.0))
    for factor, unit in UNITS.items():
        ratio = np.abs(few) / factor
        of_unit = outside & (ratio > 0.4) & (ratio < 2.5)
        if of_unit.any():
            yield repair(np.where(of_unit, np.sign(few) * factor, 1.0), unit)


def _scaled(robot: Articulated, scales: np.ndarray, unit: str, match: TorqueMatch, conventions: Conventions) -> Repair:
    """Return the repair for torques that are multiples of the arm's torques.

    - `scales`: the factor of each joint [n].
    - `unit`: a name in `UNITS`; empty if the factors are estimates.
    """
    size, n = np.abs(scales), robot.joints
    changed = size != 1.0
    alike = bool((size == size[0]).all())
    factors = conventions.each("torque_scale", n) / size
    title = f"torques in {unit}" if alike else f"torques of {joint_list(robot, changed)} in {unit}"
    if unit and alike and conventions.torque_unit == "Nm":
        sentence, option = f"{title}, {size[0]:.4g} times too large for N m", f"--torque-unit {unit.replace(' ', '')}"
    elif unit:
        sentence, option = (
            f"{title}, {size.max():.4g} times too large for N m",
            f"--torque-scale {short_number_list(factors)}",
        )
    else:
        torques = "all torques" if alike else f"torques of {joint_list(robot, changed)}"
        sentence = f"{torques} about {short_number_list(size[changed])} times as large as the arm needs"
        if size.min() < 1.0:
            sentence += " (motor currents, or torques on the motor's side of the gear?)"
        sentence += "; see the data sheet for the exact factor"
        option = f"--torque-scale {short_number_list(factors)}"
    if (scales < 0).any():
        sentence += f" and the opposite sign for {joint_list(robot, scales < 0)}"
        option += f" --torque-sign {short_number_list(np.sign(scales) * conventions.each('torque_sign', n))}"
    count = (0 if unit else 1) if alike else int(changed.sum()) + (0 if unit else 1)
    return Repair(sentence, option, count + int((scales < 0).any()), match)


def _scale_of(rigid: RigidTorques, sample: TorqueSample, sign: float = 0.0) -> tuple[float, bool]:
    """Return the best factor of the arm's rigid-body torque, and True if the sample determines this factor.

    - `sign`: sign of the factor to try, which is then returned without it; 0 to try both, and return the better factor.
    """
    weight = sample.counts / sample.size
    drives = drive_columns(sample)
    columns = np.concatenate([rigid.total[:, :, None], drives], axis=2) * weight[:, :, None]
    a = columns.reshape(-1, columns.shape[2])
    best = (np.inf, 0.0, False)
    for trial in (1.0, -1.0) if sign == 0.0 else (sign,):
        b = (trial * sample.tau * weight).ravel()
        solution = nonnegative(a, b)
        residual = float(np.sum((b - a @ solution) ** 2))
        more = float(np.sum((b - a[:, 1:] @ nonnegative(a[:, 1:], b)) ** 2))
        if residual < best[0]:
            scale = solution[0] if sign else trial * solution[0]
            best = (residual, float(scale), solution[0] > 0.0 and more > 1.2 * residual + 1e-3 * len(b))
    return best[1], best[2]


def torque_orders(
    robot: Articulated, rigid: RigidTorques, sample: TorqueSample, conventions: Conventions
) -> Iterator[Repair]:
    """Yield alternative conventions: torques in another joint order, first with their own signs, then with free signs.

    - `rigid`: torques of the arm's bodies.
    """
    n = robot.joints
    if n < 2:
        return
    cost = np.zeros((2, n, n))
    for joint, column in itertools.product(range(n), range(n)):
        own = sample.only(joint, column)
        for negative in range(2):
            signed = own.with_torques(np.zeros(1, int), np.array([1.0 - 2.0 * negative]))
            match = match_rigid_torques(rigid.only(joint), signed)
            cost[negative, joint, column] = match.score + match.cost / len(sample.tau)
    for with_signs in (False, True):
        order = optimize.linear_sum_assignment(np.minimum(cost[0], cost[1] + EACH) if with_signs else cost[0])[1]
        if (order == np.arange(n)).all():
            continue
        sign = np.ones(n)
        if with_signs:
            negative_cost, positive_cost = (costs[np.arange(n), order] for costs in (cost[1], cost[0]))
            sign = np.where(negative_cost + EACH < positive_cost, -1.0, 1.0)
        match = match_rigid_torques(rigid, sample.with_torques(order, sign))
        option = f"--torque-order {order_option(robot, order, conventions.torque_order)}"
        sentence = f"the torques of {joint_list(robot, order != np.arange(n))} interchanged"
        if (sign < 0).any():
            option += f" --torque-sign {short_number_list(sign * conventions.each('torque_sign', n))}"
            sentence += f", and the opposite sign for {joint_list(robot, sign < 0)}"
        yield Repair(sentence, option, int((order != np.arange(n)).sum() + (sign < 0).sum()), match)


def torque_delays(
    signals: LogSignals, rigid: RigidTorques, sample: TorqueSample, conventions: Conventions
) -> Iterator[Repair]:
    """Yield the alternative in which the torques are delayed or ahead in time, relative to the positions.

    - `rigid`: torques of the arm's bodies.
    """
    period = 1.0 / signals.cut_off
    steps = max(3, int(LATEST / (0.25 * period)))
    delays = np.linspace(-LATEST, LATEST, 2 * min(steps, 25) + 1)
    tau = signals.filtered(signals.tau)

    def match_of(delay: float) -> TorqueMatch:
        shifted = np.stack([np.interp(sample.t + delay, signals.t, column) for column in tau.T], axis=1)
        return match_rigid_torques(rigid, replace(sample, tau=shifted))

    best = float(min(delays, key=lambda delay: match_of(delay).score))
    near = np.linspace(best - 0.25 * period, best + 0.25 * period, 11)
    best = float(min(near, key=lambda delay: match_of(delay).score))
    if abs(best) > 0.5 / signals.rate:
        total = best + conventions.torque_delay
        when = "after" if best > 0 else "before"
        yield Repair(
            f"torques that come {abs(best):.3g} s {when} the positions",
            f"--torque-delay {total:.4g}",
            1,
            match_of(best),
        )
