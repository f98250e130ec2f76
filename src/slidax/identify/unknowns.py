"""Unknown parameters of an arm, and the equation of each log's torques that is linear in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import Articulated

from .regressor import (
    BODY,
    links_regressor,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .signals import LogSignals

TILT = 0.1
"""Prior standard deviation of each angle by which a linearised step turns gravity [rad]."""

REACH = 0.2
"""Prior distance of a body's mass from its frame [m]; it sets the scale of first moment and inertia."""

DRIVE_SCALE = 3.0
"""Prior standard deviation of a drive's parameter, as a multiple of the value that alone gives the logs' torque."""

MASS_SHARE = 0.5
"""Prior standard deviation of a link's mass, as a share of the mass."""

STANDSTILL = 1e-3
"""Velocity, rad/s or m/s, below which a joint stands still."""

FEW = 0.2
"""Least share of the rows to use for a moving joint."""

SLOW = 0.03
"""Share of a joint's largest velocity below which dry friction may stick; its equation is not used there."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """A log's torque equation `τ - known = columns @ θ` at each time and joint, and the prior of its unknowns θ.

    - `names`, `joints`: name (without the joint) and joint of each entry of θ; -1 for a parameter without a joint.
    - `columns`: the regressor [k n p].
    - `known`: torque of the known parameters [k n].
    - `prior`, `scale`: prior mean and standard deviation of θ [p].
    - `positive`: True for parameters that cannot be negative [p].
    - `bodies`: index in θ of the first parameter of each unknown body: a link, a payload or a log's load.
    - `counts`: True for equations that the fit uses [k n].
    - `carried`: inertial parameters of the known payload and load at the tip, together [10].
    - `carries`: index in θ of the first parameter of each unknown payload or load that this log's arm carries.
    """

    names: tuple[str, ...]
    joints: tuple[int, ...]
    columns: np.ndarray
    known: np.ndarray
    prior: np.ndarray
    scale: np.ndarray
    positive: np.ndarray
    bodies: tuple[int, ...]
    counts: np.ndarray
    carried: np.ndarray
    carries: tuple[int, ...]


class Sizes(NamedTuple):
    """Root mean square torque and acceleration, and largest speed, of each joint over all logs [n]."""

    torque: np.ndarray
    acceleration: np.ndarray
    speed: np.ndarray


def sizes_of(signals: Sequence[LogSignals]) -> Sizes:
    """Return the sizes of torques, accelerations and speeds over all logs."""
    return Sizes(
        np.sqrt(np.mean(np.concatenate([own.tau for own in signals]) ** 2, axis=0)),
        np.sqrt(np.mean(np.concatenate([own.motion.ddq for own in signals]) ** 2, axis=0)),
        np.max([np.abs(own.motion.dq).max(axis=0) for own in signals], axis=0),
    )


def unknowns_of(
    robot: Articulated,
    signals: LogSignals,
    sizes: Sizes,
    loads: Sequence[Payload | None],
    number: int,
    *,
    rotors: bool,
    payload: bool,
    links: bool,
    asymmetric: bool,
    stribeck: float | None,
    ripple: Sequence[float],
    ignored: np.ndarray,
) -> Unknowns:
    """Return the equation of a log, `τ = Y φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_a |q̇| + f_o`.

    `stribeck` adds the term `f_s exp(-(q̇/v_s)²) sign(q̇)`, and `ripple` adds `c cos(N q) + s sin(N q)` for each N.

    φ are the inertial parameters of links and payload, Y their regressor, J rotor inertias, f_c Coulomb friction, f_v
    viscous friction. f_o is the offset of the torque measurement, or half the difference of friction between the two
    directions: a log cannot tell them apart. f_a is half the difference of viscous friction between the two directions,
    if `asymmetric`.

    - `robot`: the arm before identification.
    - `sizes`: sizes from which the prior scales of the drives' parameters follow.
    - `loads`: load of each log in addition to the arm's own payload; None if it is unknown.
    - `number`: index of this log.
    - `rotors`, `payload`, `links`: True if rotors, payload, or the links' inertial parameters are unknown.
    - `asymmetric`: True if viscous friction may differ between the two directions.
    - `stribeck`: v_s [rad/s or m/s]; None without Stribeck friction.
    - `ripple`: N, periods of torque ripple per turn.
    - `ignored`: True for joints whose torques are not used [n].
    """
    motion, n = signals.motion, robot.joints
    names: list[str] = []
    joints: list[int] = []
    columns: list[np.ndarray] = []
    prior: list[float] = []
    scale: list[float] = []
    positive: list[bool] = []
    bodies: list[int] = []
    link_parameters = parameters_of_links(robot)

    def add_body(kind: str, joint: int, believed: np.ndarray, mass: float) -> None:
        bodies.append(len(names))
        for entry, size in zip(BODY_NAMES, (mass, *3 * (mass * REACH,), *6 * (mass * REACH**2,)), strict=True):
            names.append(f"{kind}.{entry}")
            joints.append(joint)
            scale.append(size)
        prior.extend(believed)
        positive.extend(BODY * [False])

    total = max(float(np.sum(robot.masses)), 0.1)
    if links:
        for i in range(n):
            add_body(
                "link", i, link_parameters[i * BODY :][:BODY], MASS_SHARE * max(float(robot.masses[i]), 0.02 * total)
            )
        columns.append(links_regressor(robot, motion))
    if payload:
        add_body("payload", -1, np.zeros(BODY), total)
        columns.append(payload_regressor(robot, motion))
    carries = [i for i in bodies if joints[i] < 0]
    for other, load in enumerate(loads):
        if load is None:
            carries += [len(names)] * (other == number)
            add_body(f"load_{other + 1}", -1, np.zeros(BODY), total)
            columns.append(payload_regressor(robot, motion) * (other == number))
    # Unknown bodies are not part of the known torque.
    carried = parameters_of_payload(robot.payload) * (not payload)
    own = loads[number]
    if own is not None:
        carried = carried + parameters_of_payload(own)
    known = rigid_torque(robot, motion, link_parameters * (not links), carried)

    size, largest = sizes.torque + 1e-9, np.maximum(sizes.speed, STANDSTILL)
    drives = [
        ("coulomb", np.sign(motion.dq), np.ones(n), True),
        ("viscous", motion.dq, largest, True),
        ("offset", np.ones_like(motion.dq), np.ones(n), False),
    ]
    if asymmetric:
        drives.append(("asymmetry", np.abs(motion.dq), largest, False))
    if stribeck is not None:
        drives.append(("stribeck", np.sign(motion.dq) * np.exp(-((motion.dq / stribeck) ** 2)), np.ones(n), True))
    for periods in ripple:
        for name, wave in (("cos", np.cos), ("sin", np.sin)):
            drives.append((f"ripple_{periods:g}_{name}", wave(periods * motion.q), np.ones(n), False))
    if rotors:
        drives.insert(0, ("armature", motion.ddq, sizes.acceleration + 1e-2, True))
    else:
        known += motion.ddq * np.asarray(robot.armature)
    for name, basis, unit, nonnegative in drives:
        columns.append(basis[:, :, None] * np.eye(n))
        names.extend(n * [name])
        joints.extend(range(n))
        prior.extend(np.asarray(robot.armature) if name == "armature" else np.zeros(n))
        scale.extend(DRIVE_SCALE * size / unit)
        positive.extend(n * [nonnegative])
    return Unknowns(
        names=tuple(names),
        joints=tuple(joints),
        columns=np.concatenate(columns, axis=2),
        known=known,
        prior=np.array(prior),
        scale=np.array(scale),
        positive=np.array(positive),
        bodies=tuple(bodies),
        counts=mark_moving(signals) & ~ignored,
        carried=carried,
        carries=tuple(carries),
    )


BODY_NAMES = ("mass", "moment.x", "moment.y", "moment.z", "xx", "yy", "zz", "xy", "xz", "yz")


def mark_moving(signals: LogSignals) -> np.ndarray:
    """Return True for rows in which the joint moves and does not stick, so that its Coulomb friction is known, [k n].

    The joint must move during the filter's settling time before and after the row. A joint that reverses too often for
    this gets a shorter time. For a joint that never moves, the result is True in all rows where the filter has settled.
    """
    dq = signals.motion.dq
    largest = np.maximum(np.abs(dq).max(axis=0), STANDSTILL)
    dead = np.maximum(SLOW * largest, 4.0 * signals.noise)
    slow = (np.abs(dq) < dead) & (largest > STANDSTILL)
    slides = np.empty(dq.shape, bool)
    for joint in range(dq.shape[1]):
        reach = signals.settled
        while True:
            near = np.convolve(slow[:, joint] * 1.0, np.ones(2 * reach + 1), "same") > 0.5
            slides[:, joint] = ~near & signals.inner
            # A joint that reverses too often for the filter to settle is used closer to its reversals.
            if reach == 0 or slides[:, joint].mean() > FEW:
                break
            reach //= 2
    return slides
