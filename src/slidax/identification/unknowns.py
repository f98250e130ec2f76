"""The unknown parameters: columns of the regressor, with names, scales and prior values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.robots import Articulated

from .regressor import (
    BODY,
    links_regressor,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .signals import Signals

REACH = 0.2
"""Prior distance of a body's mass from its frame [m]; it sets the scale of first moment and inertia."""

WIDE = 3.0
"""Prior scale of a drive's parameters, as a multiple of the log's own scale."""

HALF = 0.5
"""Prior standard deviation of a link's mass, as a share of it."""

STANDS = 1e-3
"""A velocity, rad/s or m/s, below which a joint does not move."""

FEW = 0.2
"""A share of the rows that a joint is used in at least, if it moves."""

SLOW = 0.03
"""Of a joint's largest velocity: where it is slower, dry friction may stick, and its equation does not count."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The equation `τ - known = columns @ θ`, at each time and joint, and what is believed of θ before.

    - `names`, `joints`: of each column, `names` without the joint; the joint is -1 where there is none.
    - `columns`: [k n p].
    - `known`: torque that is not in question [k n].
    - `prior`, `scale`: the θ believed before, and how far it may be off [p].
    - `positive`: which cannot be negative [p].
    - `bodies`: where the ten numbers of each body begin.
    - `counts`: which equations count [k n].
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


def unknowns_of(
    robot: Articulated,
    signals: Signals,
    *,
    rotors: bool,
    payload: bool,
    links: bool,
    asymmetric: bool,
    ignored: np.ndarray,
) -> Unknowns:
    """The equation of an arm, `τ = Y φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_a |q̇| + f_o`.

    f_o is the offset: of the torque's measurement, or half of what friction differs by between the two directions,
    which look the same. f_a is what viscous friction differs by, taken only if asked for.

    - `robot`: the arm as it is known.
    - `rotors`, `payload`, `links`: whether rotors, payload, and the links' inertial parameters are unknown.
    - `asymmetric`: whether viscous friction may differ between the two directions.
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
    of_links = parameters_of_links(robot)

    def add_body(what: str, at: int, believed: np.ndarray, mass: float) -> None:
        bodies.append(len(names))
        for entry, size in zip(BODY_NAMES, (mass, *3 * (mass * REACH,), *6 * (mass * REACH**2,)), strict=True):
            names.append(f"{what}.{entry}")
            joints.append(at)
            scale.append(size)
        prior.extend(believed)
        positive.extend(BODY * [False])

    total = max(float(np.sum(robot.masses)), 0.1)
    if links:
        for i in range(n):
            add_body("link", i, of_links[i * BODY :][:BODY], HALF * max(float(robot.masses[i]), 0.02 * total))
        columns.append(links_regressor(robot, motion))
    if payload:
        add_body("payload", -1, np.zeros(BODY), total)
        columns.append(payload_regressor(robot, motion))
    # Unknown bodies are not part of the known torque.
    carried = parameters_of_payload(robot.payload) * (not payload)
    known = rigid_torque(robot, motion, of_links * (not links), carried)

    size = np.sqrt(np.mean(signals.tau**2, axis=0)) + 1e-9
    largest = np.maximum(np.abs(motion.dq).max(axis=0), STANDS)
    drives = [
        ("coulomb", np.sign(motion.dq), np.ones(n), True),
        ("viscous", motion.dq, largest, True),
        ("offset", np.ones_like(motion.dq), np.ones(n), False),
    ]
    if asymmetric:
        drives.append(("asymmetry", np.abs(motion.dq), largest, False))
    if rotors:
        fastest = np.sqrt(np.mean(motion.ddq**2, axis=0)) + 1e-2
        drives.insert(0, ("armature", motion.ddq, fastest, True))
    else:
        known += motion.ddq * np.asarray(robot.armature)
    for name, basis, unit, nonnegative in drives:
        columns.append(basis[:, :, None] * np.eye(n))
        names.extend(n * [name])
        joints.extend(range(n))
        prior.extend(np.asarray(robot.armature) if name == "armature" else np.zeros(n))
        scale.extend(WIDE * size / unit)
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
        counts=moving(signals) & ~ignored,
    )


BODY_NAMES = ("mass", "moment.x", "moment.y", "moment.z", "xx", "yy", "zz", "xy", "xz", "yz")


def moving(signals: Signals) -> np.ndarray:
    """True where a joint slides for as long as the filter feels, and for all of a joint that stands [k n]."""
    dq = signals.motion.dq
    largest = np.maximum(np.abs(dq).max(axis=0), STANDS)
    dead = np.maximum(SLOW * largest, 4.0 * signals.noise)
    slow = (np.abs(dq) < dead) & (largest > STANDS)
    slides = np.empty(dq.shape, bool)
    for joint in range(dq.shape[1]):
        reach = signals.settled
        while True:
            near = np.convolve(slow[:, joint] * 1.0, np.ones(2 * reach + 1), "same") > 0.5
            slides[:, joint] = ~near & signals.inner
            # A joint that turns round more often than the filter settles is used closer to its turns.
            if reach == 0 or slides[:, joint].mean() > FEW:
                break
            reach //= 2
    return slides
