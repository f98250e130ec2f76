"""Torques of a log against the arm: their sign, scale, joint order, delay, and the direction of gravity."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from slidax._errors import DefinitionError
from slidax.robots import Articulated

from .conventions import Conventions
from .log import Log
from .motion_checks import DEGREE, TRAVEL
from .signals import Signals
from .torque_model import (
    Match,
    Rigid,
    Sample,
    drive_columns,
    matched,
    matched_rigid,
    nonnegative,
    rigid_torques,
    sample_of,
    with_gravity,
)
from .unknowns import moving

DOUBT, COSTS = 0.2, 10.0
"""A residual, as a share of the torque, and a cost of the belief per joint: above, other conventions are tried."""

BETTER = 0.7
"""By how much the sum of the logarithms of the residuals must fall for another convention: a factor of two."""

SHARE_LEFT = 0.65
"""Of that sum, which another convention may leave."""

EXPLAINS = 0.6
"""The share of the torque's power that another convention must explain."""

CLOSE = 0.4
"""A difference of scores within which two conventions fit equally well."""

EACH = 0.15
"""The score that each changed joint costs, so that the simpler of two conventions is preferred."""

SCALES = (0.4, 2.5)
"""Factors of the torques within which a wrong mass explains them as well as a wrong scale."""

ENOUGH = 0.03
"""The share of the score that a convention leaves, below which no further ones are tried."""

FEW = 4
"""Joints of which all orders are tried; of more, exchanges of two as long as the match gets better."""

UNITS = {1e3: "mN m", 1e2: "N cm", 1e-3: "kN m", 1.0 / 0.0980665: "kgf cm"}
"""The factor by which torques in other units are too large, and the unit's name."""

LATEST = 1.0
"""The delay of torques that is looked for, s."""


@dataclass(frozen=True, eq=False)
class Repair:
    """Another convention of a log.

    - `sentence`: the convention, to go after "with".
    - `option`: of the command, which applies it.
    - `joints`: how many joints it changes.
    - `match`: with it.
    """

    sentence: str
    option: str
    joints: int
    match: Match

    @property
    def score(self) -> float:
        """The match's score, and the cost of the changes."""
        return self.match.score + EACH * self.joints


def require_torques(
    log: Log,
    robot: Articulated,
    signals: Signals,
    usable: np.ndarray,
    conventions: Conventions,
) -> None:
    """Raise a DefinitionError if the torques contradict the arm and fit it with another convention.

    - `log`: in the arm's units and joint order, as far as known.
    - `robot`: the arm.
    - `signals`: of the log, in a band of a few Hz.
    - `usable`: True for joints whose torques are used [n].
    - `conventions`: that were applied.
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

    - `log`: in the arm's units and joint order.
    - `robot`: the arm.
    - `conventions`: that were applied.

    Raises DefinitionError if the torque of a joint that moves is constant, or all torques are.
    """
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
        f"the torque of {log.source} is constant for {_named(robot, constant)}, which stand still, as with a brake: "
        "it is left out"
    ]


def _repairs(
    robot: Articulated, signals: Signals, sample: Sample, match: Match, conventions: Conventions
) -> list[Repair]:
    """Other conventions with their matches; the costly ones are left out after one that explains all."""
    rigid = rigid_torques(robot, sample.motion)
    stages: tuple[Callable[[], Iterator[Repair]], ...] = (
        lambda: _signs(robot, rigid, sample, conventions),
        lambda: _scales(robot, rigid, sample, conventions),
        lambda: _torque_orders(robot, rigid, sample, conventions),
        lambda: _positions(robot, sample, conventions),
        lambda: _delays(signals, rigid, sample, conventions),
        lambda: _gravity(robot, sample),
        lambda: _joint_orders(robot, sample, conventions),
    )
    repairs: list[Repair] = []
    for stage in stages:
        repairs += stage()
        if any(repair.match.score < ENOUGH * match.score for repair in repairs):
            break
    return sorted(repairs, key=lambda repair: repair.score)


def _signs(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    n, same = robot.joints, np.arange(robot.joints)

    def match_of(sign: np.ndarray) -> Match:
        return matched_rigid(rigid, sample.with_torques(same, sign))

    for start in (np.ones(n), -np.ones(n)):
        sign, match = _improved(start, match_of, _flips)
        if (sign < 0).any():
            yield Repair(
                f"the opposite sign for {_named(robot, sign < 0)}",
                f"--torque-sign {_same(sign * conventions.each('torque_sign', n))}",
                1 if (sign < 0).all() else int((sign < 0).sum()),
                match,
            )
    one, zero = np.ones(n), np.zeros(n)
    for start in (one, -one):
        sign, match = _improved(start, lambda sign: matched(robot, sample.with_positions(same, sign, zero)), _flips)
        if (sign < 0).any():
            yield Repair(
                f"the opposite direction of the positions of {_named(robot, sign < 0)}",
                f"--position-sign {_same(sign * conventions.each('position_sign', n))}",
                2 if (sign < 0).all() else 1 + int((sign < 0).sum()),
                match,
            )


def _scales(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    n = robot.joints

    def repair(scales: np.ndarray, unit: str = "") -> Repair:
        match = matched_rigid(rigid, sample.with_torques(np.arange(n), 1.0 / scales))
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
    # A joint without a rigid torque of its own shows no scale: it has that of the others.
    each = [_scale_of(rigid.only(j), sample.only(j, j)) for j in range(n)]
    scales = np.array([scale if shows else 0.0 for scale, shows in each])
    shown_scales = np.abs(scales[scales != 0.0])
    if not len(shown_scales):
        return
    outside = (scales != 0.0) & ((np.abs(scales) < SCALES[0]) | (np.abs(scales) > SCALES[1]))
    if not outside.any():
        return
    yield repair(np.where(scales == 0.0, np.median(shown_scales), scales))
    few = np.where(outside, scales, 1.0)
    yield repair(few)
    for factor, unit in UNITS.items():
        ratio = np.abs(few) / factor
        of_unit = outside & (ratio > 0.4) & (ratio < 2.5)
        if of_unit.any():
            yield repair(np.where(of_unit, np.sign(few) * factor, 1.0), unit)


def _scaled(robot: Articulated, scales: np.ndarray, unit: str, match: Match, conventions: Conventions) -> Repair:
    """Torques that are some multiples of what the arm needs, as a repair.

    A unit is a name of `UNITS`; without one, the scale is an estimate.
    """
    size, n = np.abs(scales), robot.joints
    changed = size != 1.0
    alike = bool((size == size[0]).all())
    factors = conventions.each("torque_scale", n) / size
    named = f"torques in {unit}" if alike else f"torques of {_named(robot, changed)} in {unit}"
    if unit and alike and conventions.torque_unit == "Nm":
        sentence, option = f"{named}, {size[0]:.4g} times too large for N m", f"--torque-unit {unit.replace(' ', '')}"
    elif unit:
        sentence, option = f"{named}, {size.max():.4g} times too large for N m", f"--torque-scale {_same(factors)}"
    else:
        of = "all torques" if alike else f"torques of {_named(robot, changed)}"
        sentence = f"{of} about {_same(size[changed])} times what the arm needs"
        if size.min() < 1.0:
            sentence += " (motor currents, or torques on the motor's side of the gear?)"
        sentence += ", which the data sheet tells more exactly"
        option = f"--torque-scale {_same(factors)}"
    if (scales < 0).any():
        sentence += f" and the opposite sign for {_named(robot, scales < 0)}"
        option += f" --torque-sign {_same(np.sign(scales) * conventions.each('torque_sign', n))}"
    count = (0 if unit else 1) if alike else int(changed.sum()) + (0 if unit else 1)
    return Repair(sentence, option, count + int((scales < 0).any()), match)


def _scale_of(rigid: Rigid, sample: Sample, sign: float = 0.0) -> tuple[float, bool]:
    """The factor of the arm's own torque that fits best, and whether the torque shows it.

    Without a `sign` both are tried, and the factor has the better.
    """
    weight = sample.counts / sample.size
    drives = drive_columns(sample)
    whole = np.concatenate([rigid.total[:, :, None], drives], axis=2) * weight[:, :, None]
    a = whole.reshape(-1, whole.shape[2])
    best = (np.inf, 0.0, False)
    for turned in (1.0, -1.0) if sign == 0.0 else (sign,):
        b = (turned * sample.tau * weight).ravel()
        solution = nonnegative(a, b)
        residual = float(np.sum((b - a @ solution) ** 2))
        more = float(np.sum((b - a[:, 1:] @ nonnegative(a[:, 1:], b)) ** 2))
        if residual < best[0]:
            scale = solution[0] if sign else turned * solution[0]
            best = (residual, float(scale), solution[0] > 0.0 and more > 1.2 * residual + 1e-3 * len(b))
    return best[1], best[2]


def _torque_orders(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    n = robot.joints
    if n < 2:
        return
    cost = np.zeros((2, n, n))
    for joint, column in itertools.product(range(n), range(n)):
        own = sample.only(joint, column)
        for turned in range(2):
            signed = own.with_torques(np.zeros(1, int), np.array([1.0 - 2.0 * turned]))
            match = matched_rigid(rigid.only(joint), signed)
            cost[turned, joint, column] = match.score + match.cost / len(sample.tau)
    for with_signs in (False, True):
        order = optimize.linear_sum_assignment(np.minimum(cost[0], cost[1] + EACH) if with_signs else cost[0])[1]
        if (order == np.arange(n)).all():
            continue
        sign = np.ones(n)
        if with_signs:
            turned_cost, plain_cost = (costs[np.arange(n), order] for costs in (cost[1], cost[0]))
            sign = np.where(turned_cost + EACH < plain_cost, -1.0, 1.0)
        match = matched_rigid(rigid, sample.with_torques(order, sign))
        option = f"--torque-order {_order(robot, order, conventions.torque_order)}"
        sentence = f"the torques of {_named(robot, order != np.arange(n))} interchanged"
        if (sign < 0).any():
            option += f" --torque-sign {_same(sign * conventions.each('torque_sign', n))}"
            sentence += f", and the opposite sign for {_named(robot, sign < 0)}"
        yield Repair(sentence, option, int((order != np.arange(n)).sum() + (sign < 0).sum()), match)


def _joint_orders(robot: Articulated, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    n = robot.joints
    one, zero = np.ones(n), np.zeros(n)

    def match_both(order: np.ndarray) -> Match:
        return matched(robot, sample.with_positions(order, one, zero).with_torques(order, one))

    def match_positions(order: np.ndarray) -> Match:
        return matched(robot, sample.with_positions(order, one, zero))

    for match_of, option, given, what in (
        (match_both, "--joint-order", conventions.joint_order, "positions and torques"),
        (match_positions, "--position-order", conventions.position_order, "positions"),
    ):
        if n <= FEW:
            tried = [(order, match_of(order)) for order in map(np.array, itertools.permutations(range(n)))]
        else:
            alphabetical = np.argsort(robot.joint_names)
            others = (np.arange(n)[::-1], alphabetical, np.argsort(alphabetical))
            tried = [_improved(np.arange(n), match_of, _exchanges)]
            tried += [(order, match_of(order)) for order in others]
        order, match = min(tried, key=lambda pair: pair[1].score)
        if (order != np.arange(n)).any():
            moved = order != np.arange(n)
            yield Repair(
                f"the {what} of {_named(robot, moved)} interchanged",
                f"{option} {_order(robot, order, given)}",
                int(moved.sum()),
                match,
            )


def _positions(robot: Articulated, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    n = robot.joints
    same, one, zero = np.arange(n), np.ones(n), np.zeros(n)
    turning = np.array([unit == "rad" for unit in robot.joint_units])
    if turning.any() and np.abs(sample.motion.q[:, turning]).max() > 0.5:
        degrees = sample.with_positions(same, np.where(turning, DEGREE, 1.0), zero)
        yield Repair("positions in degrees", "--position-unit deg", 1, matched(robot, degrees))

    def quarters(offset: np.ndarray) -> Iterator[np.ndarray]:
        for joint in np.nonzero(turning)[0]:
            for quarter in (0.5 * np.pi, np.pi, 1.5 * np.pi):
                other = offset.copy()
                other[joint] = (offset[joint] + quarter + np.pi) % (2.0 * np.pi) - np.pi
                yield other

    zeros, match = _improved(zero, lambda offset: matched(robot, sample.with_positions(same, one, offset)), quarters)
    if zeros.any():
        total = zeros + conventions.each("position_offset", n)
        yield Repair(
            f"another zero of the positions of {_named(robot, zeros != 0.0)}",
            f"--position-offset {_list(total, 5)}",
            2 * int((zeros != 0.0).sum()),
            match,
        )


def _gravity(robot: Articulated, sample: Sample) -> Iterator[Repair]:
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
            f"--gravity {_list(gravity, 4)}",
            2,
            matched(with_gravity(robot, gravity), sample),
        )


def _delays(signals: Signals, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    period = 1.0 / signals.cut_off
    steps = max(3, int(LATEST / (0.25 * period)))
    delays = np.linspace(-LATEST, LATEST, 2 * min(steps, 25) + 1)
    tau = signals.filtered(signals.tau)

    def match_of(delay: float) -> Match:
        late = np.stack([np.interp(sample.t + delay, signals.t, column) for column in tau.T], axis=1)
        return matched_rigid(rigid, replace(sample, tau=late))

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


def _improved(
    start: np.ndarray, match_of: Callable[[np.ndarray], Match], others: Callable[[np.ndarray], Iterator[np.ndarray]]
) -> tuple[np.ndarray, Match]:
    """The best after changes of one entry after another, as long as the match gets better."""
    best, match = start, match_of(start)
    for _ in range(len(start)):
        scored = [(match_of(other), other) for other in others(best)]
        candidate, other = min(scored, key=lambda pair: pair[0].score)
        if candidate.score > match.score - EACH:
            break
        best, match = other, candidate
    return best, match


def _flips(sign: np.ndarray) -> Iterator[np.ndarray]:
    for joint in range(len(sign)):
        other = sign.copy()
        other[joint] *= -1.0
        yield other


def _exchanges(order: np.ndarray) -> Iterator[np.ndarray]:
    for a, b in itertools.combinations(range(len(order)), 2):
        other = order.copy()
        other[[a, b]] = order[[b, a]]
        yield other


def _order(robot: Articulated, order: np.ndarray, earlier: object) -> str:
    """The option's list: for each joint of the log as read, the joint that its values belong to."""
    names = list(robot.joint_names)
    belongs = {names[column]: names[joint] for joint, column in enumerate(order)}
    labels = list(earlier) if isinstance(earlier, (list, tuple)) and earlier else names
    return ",".join(belongs[label] for label in labels)


def _named(robot: Articulated, which: np.ndarray) -> str:
    names = [f"`{name}`" for name, chosen in zip(robot.joint_names, which, strict=True) if chosen]
    return "all joints" if len(names) == robot.joints and len(names) > 1 else ", ".join(names)


def _list(values: np.ndarray, digits: int = 3) -> str:
    return ",".join(f"{value + 0.0:.{digits}g}" for value in values)


def _same(values: np.ndarray) -> str:
    """As a list, or as one entry where all are the same."""
    return _list(values[:1] if (values == values[0]).all() else values)
