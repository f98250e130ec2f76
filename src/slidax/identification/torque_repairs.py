"""Other signs, scales, joint orders and delays of a log's torques."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from slidax.robots import Articulated

from .conventions import Conventions
from .repair import EACH, Repair, flips, improved, named, order_option, same_or_listed
from .sample import Sample
from .signals import Signals
from .torque_model import Match, Rigid, drive_columns, matched_rigid, nonnegative

SCALES = (0.4, 2.5)
"""Factors of the torques within which a wrong mass explains them as well as a wrong scale."""

SHARES = (0.7, 1.4)
"""The same for single joints, where the torques of the others show the masses."""

UNITS = {1e3: "mN m", 1e2: "N cm", 1e-3: "kN m", 1.0 / 0.0980665: "kgf cm"}
"""The factor by which torques in other units are too large, and the unit's name."""

LATEST = 1.0
"""The delay of torques that is looked for, s."""


def torque_signs(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Torques with the opposite sign, of all joints or of some.

    - `rigid`: torques of its bodies.
    """
    n, same = robot.joints, np.arange(robot.joints)

    def match_of(sign: np.ndarray) -> Match:
        return matched_rigid(rigid, sample.with_torques(same, sign))

    for start in (np.ones(n), -np.ones(n)):
        sign, match = improved(start, match_of, flips)
        if (sign < 0).any():
            yield Repair(
                f"the opposite sign for {named(robot, sign < 0)}",
                f"--torque-sign {same_or_listed(sign * conventions.each('torque_sign', n))}",
                1 if (sign < 0).all() else int((sign < 0).sum()),
                match,
            )


def torque_scales(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Torques in another unit, as currents, or of the motor's side of the gear.

    - `rigid`: torques of its bodies.
    """
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
    outside = (scales != 0.0) & ((np.abs(scales) < SHARES[0]) | (np.abs(scales) > SHARES[1]))
    if not outside.any():
        return
    yield repair(np.where(scales == 0.0, np.median(shown_scales), scales))
    few = np.where(outside, scales, 1.0)
    yield repair(few)
    # Relative to the other joints, if a payload makes all of them seem larger.
    relative = scales / np.median(shown_scales)
    apart = (scales != 0.0) & ((np.abs(relative) < SHARES[0]) | (np.abs(relative) > SHARES[1]))
    for joint in np.nonzero(outside)[0]:
        others = np.delete(np.abs(scales), joint)
        own = scales[joint] / np.median(others[others > 0.0]) if (others > 0.0).any() else scales[joint]
        yield repair(np.where(np.arange(n) == joint, own, 1.0))
    if apart.any():
        yield repair(np.where(apart, relative, 1.0))
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
    title = f"torques in {unit}" if alike else f"torques of {named(robot, changed)} in {unit}"
    if unit and alike and conventions.torque_unit == "Nm":
        sentence, option = f"{title}, {size[0]:.4g} times too large for N m", f"--torque-unit {unit.replace(' ', '')}"
    elif unit:
        sentence, option = (
            f"{title}, {size.max():.4g} times too large for N m",
            f"--torque-scale {same_or_listed(factors)}",
        )
    else:
        of = "all torques" if alike else f"torques of {named(robot, changed)}"
        sentence = f"{of} about {same_or_listed(size[changed])} times what the arm needs"
        if size.min() < 1.0:
            sentence += " (motor currents, or torques on the motor's side of the gear?)"
        sentence += ", which the data sheet tells more exactly"
        option = f"--torque-scale {same_or_listed(factors)}"
    if (scales < 0).any():
        sentence += f" and the opposite sign for {named(robot, scales < 0)}"
        option += f" --torque-sign {same_or_listed(np.sign(scales) * conventions.each('torque_sign', n))}"
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


def torque_orders(robot: Articulated, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Torques in another joint order, perhaps with other signs.

    - `rigid`: torques of its bodies.
    """
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
        option = f"--torque-order {order_option(robot, order, conventions.torque_order)}"
        sentence = f"the torques of {named(robot, order != np.arange(n))} interchanged"
        if (sign < 0).any():
            option += f" --torque-sign {same_or_listed(sign * conventions.each('torque_sign', n))}"
            sentence += f", and the opposite sign for {named(robot, sign < 0)}"
        yield Repair(sentence, option, int((order != np.arange(n)).sum() + (sign < 0).sum()), match)


def torque_delays(signals: Signals, rigid: Rigid, sample: Sample, conventions: Conventions) -> Iterator[Repair]:
    """Torques that come after the positions, or before them.

    - `rigid`: torques of the arm's bodies.
    """
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
