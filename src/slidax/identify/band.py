"""The band in which the true arm lies, at a stated confidence for all parameters at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.arms.articulated import Articulated

from .mass_bound import SPATIAL, MassBound
from .regressor import (
    BODY,
    JointMotion,
    links_regressor,
    parameters_of_body,
    parameters_of_links,
)

DRAWS = 1000
"""Errors that are drawn from their distribution, to find how large a region must be."""

CHUNK = 250
"""Of these are refined at once."""

INTERVALS = ("armature", "coulomb", "viscous")
"""Numbers of drives that have an interval each."""


@dataclass(frozen=True, eq=False)
class Band:
    """A joint confidence region of an arm's parameters: all of its statements hold at once with `confidence`.

    The true arm is within a relative distance p of the identified one in the sense that

        (1 - p) M₀(q) ≤ M(q) ≤ (1 + p) M₀(q)   for every q,                                                  (1)

    as matrix inequalities, with M₀ the mass matrix of the identified arm, payload and rotors included. The region is
    defined by this inequality, as `MassBound` proves it for an error of the parameters: not for samples of q, but for
    all. Only base parameters show in a log. Changes of the others leave M, C and G as they are, and p does not depend
    on them.

    For the torque of a motion the region has a second bound. The errors of the base parameters lie in an ellipsoid, and
    Y Δφ over an ellipsoid has its largest value in closed form (`torque_error`):

        |τ(q, q̇, q̈) - τ₀(q, q̇, q̈)|_i ≤ |Y_i(q, q̇, q̈) Dᵀ|,   τ = M q̈ + C q̇ + G,                               (2)

    with the rows of D, `deviations`. It bounds the errors of C and G, too.

    - `confidence`: for all of this at once, under normally distributed errors with the covariance of the fit.
    - `p`: of (1).
    - `armature`, `coulomb`, `viscous`: intervals, lower and upper ends [2 n]; empty [2 0] if not identified.
    - `deviations`: D [r 11n], of the ten numbers of each body, the payload merged into the one that carries it, and of
      the rotors. All `φ₀ + ξ D` with `|ξ| ≤ 1` are in the ellipsoid.
    - `links`: True if links were identified; False if they are taken as exact.
    """

    confidence: float
    p: float
    armature: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    deviations: np.ndarray
    links: bool

    def torque_error(self, robot: Articulated, motion: JointMotion) -> np.ndarray:
        """Return the largest error of the torque, friction excluded, for all arms of the region, [k n].

        - `robot`: the identified arm.
        - `motion`: at k times.
        """
        return np.linalg.norm(inertial_regressor(robot, motion) @ self.deviations.T, axis=2)

    def as_json(self) -> dict[str, Any]:
        """The band as `slidax identify --json` prints it."""
        return {
            "confidence": self.confidence,
            "p": self.p,
            **{name: getattr(self, name).tolist() for name in INTERVALS if getattr(self, name).size},
            "links": self.links,
        }

    def __str__(self) -> str:
        of = "links, payload and rotors" if self.links else "payload and rotors, with exact links"
        return f"band: p = {100 * self.p:.2g} % of the mass matrix ({of}; {100 * self.confidence:g} % confidence)"


@dataclass(frozen=True, eq=False)
class EstimateErrors:
    """An estimate and the covariance of its errors.

    - `names`, `joints`: of each parameter, as in `Unknowns`.
    - `bodies`: where the ten numbers of each body begin.
    - `theta`, `covariance`: the estimate [p], the covariance of its errors [p p].
    """

    names: tuple[str, ...]
    joints: tuple[int, ...]
    bodies: tuple[int, ...]
    theta: np.ndarray
    covariance: np.ndarray


def band_of(robot: Articulated, estimate: EstimateErrors, *, confidence: float = 0.95) -> Band:
    """Return the band of an identified arm.

    Each of its statements has a level of its own, the same for all; the least level for which all hold at once in
    `confidence` of the cases. That is found by drawing errors from their distribution, with a fixed seed.

    - `robot`: the identified arm.
    - `estimate`: its parameters.

    Raises DefinitionError if the arm's mass matrix is not bounded by `MassBound`.
    """
    names, covariance = np.array(estimate.names), estimate.covariance
    arm = arm_parameters(robot)
    to_arm = _to_arm(robot, estimate)
    base, scale = base_parameters(robot)
    into_base = base.T @ (to_arm / scale[:, None])
    # In units in which all errors are alike, so that the factor is of good condition.
    unit = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    factor = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    errors = np.random.default_rng(0).normal(size=(DRAWS, len(unit))) @ factor.T
    of_base = into_base @ factor
    left, spread, _ = np.linalg.svd(of_base, full_matrices=False)
    shown = spread > 1e-9 * max(spread.max(initial=0.0), 1e-300)
    left, spread = left[:, shown], spread[shown]
    ellipsoid = np.linalg.norm(errors @ into_base.T @ left / spread, axis=1)
    drives = np.isin(names, INTERVALS)
    relative = np.abs(errors[:, drives]) / unit[drives]
    bound = MassBound(robot, arm)
    mass = _tail(bound, (errors @ into_base.T @ base.T) * scale, 1.0 - confidence)
    p, radius, sigmas = _at_once(np.stack([mass, ellipsoid, relative.max(axis=1, initial=0.0)]), confidence)
    intervals = {}
    for name in INTERVALS:
        own = names == name
        ends = estimate.theta[own] + sigmas * np.array([[-1.0], [1.0]]) * unit[own]
        intervals[name] = np.maximum(ends, 0.0)
    return Band(
        confidence=confidence,
        p=p,
        deviations=radius * (base @ (left * spread)).T * scale,
        links=bool(np.any([name.startswith("link.") for name in names])),
        **intervals,
    )


def arm_parameters(robot: Articulated) -> np.ndarray:
    """Return the ten numbers of each body, the payload merged into the body that carries it, and the rotors, [11n].

    - `robot`: an arm.
    """
    bodies = parameters_of_links(robot).copy()
    payload, turn = robot.payload, np.asarray(robot.tip_rotation)
    center = np.asarray(robot.tip_translation) + turn @ np.asarray(payload.center)
    inertia = np.asarray(payload.inertia)
    inertia = inertia * np.eye(3) if inertia.ndim == 0 else inertia
    bodies[robot.tip_joint * BODY :][:BODY] += parameters_of_body(float(payload.mass), center, turn @ inertia @ turn.T)
    return np.concatenate([bodies, np.asarray(robot.armature)])


def inertial_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """Return Y with `M q̈ + C q̇ + G = Y φ`, φ as from `arm_parameters`, [k n 11n].

    - `robot`: its frames.
    - `motion`: at k times.
    """
    return np.concatenate([links_regressor(robot, motion), motion.ddq[:, :, None] * np.eye(robot.joints)], axis=2)


def base_parameters(robot: Articulated) -> tuple[np.ndarray, np.ndarray]:
    """Return an orthonormal basis of the combinations that show in some torque [11n r], and the units of φ [11n].

    It spans the row space of Y at random states. The entries of Y are analytic functions of the state, so that what
    gives no torque at so many random states gives none at all.

    - `robot`: its frames.
    """
    n = robot.joints
    rng = np.random.default_rng(0)
    motion = JointMotion(
        rng.uniform(-np.pi, np.pi, (20 * n, n)), rng.normal(size=(20 * n, n)), rng.normal(size=(20 * n, n))
    )
    rows = inertial_regressor(robot, motion).reshape(-1, (BODY + 1) * n)
    size = np.sqrt(np.mean(rows**2, axis=0))
    scale = 1.0 / np.maximum(size, 1e-3 * size.max())
    _, values, vectors = np.linalg.svd(rows * scale, full_matrices=False)
    return vectors[values > 1e-9 * values[0]].T, scale


def _to_arm(robot: Articulated, estimate: EstimateErrors) -> np.ndarray:
    """The parameters of the arm that each unknown adds to, [11n p]."""
    n = robot.joints
    to_arm = np.zeros(((BODY + 1) * n, len(estimate.names)))
    for start in estimate.bodies:
        body = estimate.joints[start]
        own = slice(start, start + BODY)
        if body >= 0:
            to_arm[body * BODY : (body + 1) * BODY, own] = np.eye(BODY)
        else:
            to_arm[robot.tip_joint * BODY : (robot.tip_joint + 1) * BODY, own] = _from_tip(robot)
    for i, name in enumerate(estimate.names):
        if name == "armature":
            to_arm[BODY * n + estimate.joints[i], i] = 1.0
    return to_arm


def _from_tip(robot: Articulated) -> np.ndarray:
    """The ten numbers of a body in the axes of the joint that carries the tip, from those in the tip's, [10 10]."""
    motion = np.eye(6)
    turn, place = np.asarray(robot.tip_rotation), np.asarray(robot.tip_translation)
    cross = np.array([[0.0, -place[2], place[1]], [place[2], 0.0, -place[0]], [-place[1], place[0], 0.0]])
    motion[:3, :3] = motion[3:, 3:] = turn.T
    motion[3:, :3] = -turn.T @ cross
    flat = SPATIAL.reshape(BODY, -1)
    moved = (motion.T @ SPATIAL @ motion).reshape(BODY, -1)
    return np.linalg.lstsq(flat.T, moved.T, rcond=None)[0]


def _tail(bound: MassBound, errors: np.ndarray, share: float) -> np.ndarray:
    """Bounds of all errors, exact for the largest ones: a share of all at least."""
    bounds = bound.of(errors, refine=False)
    order = np.argsort(-bounds)
    count = int(np.ceil(share * len(errors))) + 1
    best = np.zeros(0)
    for start in range(0, len(order), CHUNK):
        own = order[start : start + CHUNK]
        bounds[own] = bound.of(errors[own])
        best = np.sort(np.concatenate([best, bounds[own]]))[-count:]
        # Refined bounds are not larger than the rough ones: what is left is smaller than these.
        if start + CHUNK < len(order) and len(best) == count and best[0] >= bounds[order[start + CHUNK]]:
            break
    return bounds


def _at_once(statistics: np.ndarray, confidence: float) -> np.ndarray:
    """The values of some statistics, at a level that is the same for all, which hold at once."""
    ordered = np.sort(statistics, axis=1)
    draws = statistics.shape[1]
    for rank in range(int(np.ceil(confidence * draws)) - 1, draws):
        if np.mean((statistics <= ordered[:, rank, None]).all(axis=0)) >= confidence:
            break
    return ordered[:, rank]
