"""The band of an identified arm: a simultaneous confidence region of all its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.arms.articulated import Articulated

from .mass_bound import SPATIAL, MassBound, change_of_axes
from .regressor import (
    BODY,
    JointMotion,
    links_regressor,
    parameters_of_body,
    parameters_of_links,
)

DRAWS = 1000
"""Number of random parameter errors from which the region's size is determined."""

CHUNK = 250
"""Number of random parameter errors whose bounds are refined together."""

INTERVALS = ("armature", "coulomb", "viscous")
"""Drive parameters for which the band has intervals."""


@dataclass(frozen=True, eq=False)
class Band:
    """Bounds of an identified arm's errors, which hold together with the probability `confidence`.

    They are bounds of the mass matrix, of the torque along a motion, and of each joint's rotor inertia and friction.

    The true arm's mass matrix M, with payload and rotors, is within a relative distance p of the identified arm's M₀:

        (1 - p) M₀(q) ≤ M(q) ≤ (1 + p) M₀(q)   for every q,                                                  (1)

    as matrix inequalities. For a given error of the parameters `MassBound` proves (1) for all q, not only for samples
    of q. A log determines only the base parameters: the combinations of parameters that change the torque
    `M q̈ + C q̇ + G`. The distance p does not depend on other combinations.

    A second bound is for the torque along a motion. Let φ be the arm's inertial parameters (`arm_parameters`), φ₀ those
    of the identified arm, and Y the regressor with `M q̈ + C q̇ + G = Y φ`. The errors `Δφ = φ - φ₀` of the base
    parameters lie in an ellipsoid, over which the maximum of Y Δφ has a closed form (`torque_error`):

        |τ(q, q̇, q̈) - τ₀(q, q̇, q̈)|_i ≤ |Y_i(q, q̇, q̈) Dᵀ|,   τ = M q̈ + C q̇ + G,                               (2)

    with τ₀ the identified arm's torque, Y_i row i of Y, and D the matrix `deviations`. The second bound includes the
    errors of C and G.

    - `confidence`: confidence that all bounds hold together, for normally distributed errors with the fit's covariance.
    - `p`: relative distance in (1).
    - `armature`, `coulomb`, `viscous`: intervals of each joint's rotor inertia and friction coefficients, lower ends,
      then upper ends [2 n]; empty [2 0] if not identified.
    - `deviations`: D, r deviations of φ that span the ellipsoid [r 11n], each in the order of `arm_parameters`. The
      ellipsoid is the set of all errors `Δφ = ξ D` with `|ξ| ≤ 1`.
    - `links`: True if links were identified; False if their parameters are taken as exact.
    """

    confidence: float
    p: float
    armature: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    deviations: np.ndarray
    links: bool

    def torque_error(self, robot: Articulated, motion: JointMotion) -> np.ndarray:
        """Return the bound (2) of each joint's torque error along a motion, without friction torques, [k n], N m or N.

        - `robot`: the identified arm.
        - `motion`: the motion at k times.
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

    - `names`, `joints`: name and joint of each parameter, as in `Unknowns`.
    - `bodies`: index of each body's first parameter.
    - `theta`, `covariance`: the estimate [p], the covariance of its errors [p p].
    """

    names: tuple[str, ...]
    joints: tuple[int, ...]
    bodies: tuple[int, ...]
    theta: np.ndarray
    covariance: np.ndarray


def band_of(robot: Articulated, estimate: EstimateErrors, *, confidence: float = 0.95) -> Band:
    """Return the band of an identified arm: bounds of its errors that hold together with probability `confidence`.

    They bound the mass matrix, the torque along a motion, rotor inertias and friction (`Band`). Each is a quantile over
    1000 random parameter errors with the estimate's covariance and a fixed seed. All bounds have the same quantile
    level, the lowest for which they hold together with `confidence`.

    - `robot`: the identified arm.
    - `estimate`: its parameters, with the covariance of their errors.
    - `confidence`: confidence that all bounds hold together, in (0, 1).

    Raises DefinitionError if `MassBound` cannot bound the arm's mass matrix.
    """
    names, covariance = np.array(estimate.names), estimate.covariance
    arm = arm_parameters(robot)
    to_arm = _to_arm(robot, estimate)
    base, scale = base_parameters(robot)
    into_base = base.T @ (to_arm / scale[:, None])
    # Scaled to errors of equal size, so that the factor is well conditioned.
    unit = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    factor = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    errors = np.random.default_rng(0).normal(size=(DRAWS, len(unit))) @ factor.T
    base_factor = into_base @ factor
    left, spread, _ = np.linalg.svd(base_factor, full_matrices=False)
    shown = spread > 1e-9 * max(spread.max(initial=0.0), 1e-300)
    left, spread = left[:, shown], spread[shown]
    ellipsoid = np.linalg.norm(errors @ into_base.T @ left / spread, axis=1)
    drives = np.isin(names, INTERVALS)
    relative = np.abs(errors[:, drives]) / unit[drives]
    bound = MassBound(robot, arm)
    mass = _tail(bound, (errors @ into_base.T @ base.T) * scale, 1.0 - confidence)
    p, radius, sigmas = _simultaneous_values(np.stack([mass, ellipsoid, relative.max(axis=1, initial=0.0)]), confidence)
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
    """Return an arm's inertial parameters φ [11n]: ten per link as in `parameters_of_body`, then the rotor inertias.

    The payload is included in the link that carries it.

    - `robot`: an arm.
    """
    bodies = parameters_of_links(robot).copy()
    payload, rotation = robot.payload, np.asarray(robot.tip_rotation)
    center = np.asarray(robot.tip_translation) + rotation @ np.asarray(payload.center)
    inertia = np.asarray(payload.inertia)
    inertia = inertia * np.eye(3) if inertia.ndim == 0 else inertia
    inertia = rotation @ inertia @ rotation.T
    bodies[robot.tip_joint * BODY :][:BODY] += parameters_of_body(float(payload.mass), center, inertia)
    return np.concatenate([bodies, np.asarray(robot.armature)])


def inertial_regressor(robot: Articulated, motion: JointMotion) -> np.ndarray:
    """Return the regressor Y with `M q̈ + C q̇ + G = Y φ`, φ as from `arm_parameters`, [k n 11n].

    - `robot`: the arm; only its geometry and gravity are used.
    - `motion`: the motion at k times.
    """
    return np.concatenate([links_regressor(robot, motion), motion.ddq[:, :, None] * np.eye(robot.joints)], axis=2)


def base_parameters(robot: Articulated) -> tuple[np.ndarray, np.ndarray]:
    """Return an orthonormal basis of the base parameters [11n r], and the unit of each inertial parameter [11n].

    The base parameters are the combinations of φ (as from `arm_parameters`) that change the torque. The basis is for φ
    divided by these units. The unit of an entry of φ is the inverse root mean square of its column in the regressor Y.
    The basis spans the row space of the scaled Y at random states. The entries of Y are analytic functions of the
    state: a combination that gives no torque at so many random states never gives a torque.

    - `robot`: the arm; only its geometry and gravity are used.
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
    """Return the matrix that maps the fit's p unknowns to the arm's parameters (`arm_parameters`), [11n p]."""
    n = robot.joints
    to_arm = np.zeros(((BODY + 1) * n, len(estimate.names)))
    for start in estimate.bodies:
        body = estimate.joints[start]
        own = slice(start, start + BODY)
        if estimate.names[start].startswith("load_"):
            continue  # The load of a log is not part of the arm.
        if body >= 0:
            to_arm[body * BODY : (body + 1) * BODY, own] = np.eye(BODY)
        else:
            to_arm[robot.tip_joint * BODY : (robot.tip_joint + 1) * BODY, own] = _from_tip(robot)
    for i, name in enumerate(estimate.names):
        if name == "armature":
            to_arm[BODY * n + estimate.joints[i], i] = 1.0
    return to_arm


def _from_tip(robot: Articulated) -> np.ndarray:
    """Matrix from a body's ten parameters in the tip's frame to those in the frame of the tip's joint, [10 10]."""
    motion = change_of_axes(np.asarray(robot.tip_rotation), np.asarray(robot.tip_translation))
    flat = SPATIAL.reshape(BODY, -1)
    moved = (motion.T @ SPATIAL @ motion).reshape(BODY, -1)
    return np.linalg.lstsq(flat.T, moved.T, rcond=None)[0]


def _tail(bound: MassBound, errors: np.ndarray, share: float) -> np.ndarray:
    """Return the bound p of each parameter error [s]; at least the largest ones, a share of all, are refined."""
    bounds = bound.of(errors, refine=False)
    order = np.argsort(-bounds)
    count = int(np.ceil(share * len(errors))) + 1
    best = np.zeros(0)
    for start in range(0, len(order), CHUNK):
        own = order[start : start + CHUNK]
        bounds[own] = bound.of(errors[own])
        best = np.sort(np.concatenate([best, bounds[own]]))[-count:]
        # A refined bound is at most its rough bound, so no remaining bound exceeds the refined ones in `best`.
        if start + CHUNK < len(order) and len(best) == count and best[0] >= bounds[order[start + CHUNK]]:
            break
    return bounds


def _simultaneous_values(statistics: np.ndarray, confidence: float) -> np.ndarray:
    """Return an upper bound of each statistic [s], so that all bounds hold together with `confidence`.

    Each bound is a quantile of its statistic, at the lowest common level.

    - `statistics`: values of the statistics for each random draw [s draws].
    """
    ordered = np.sort(statistics, axis=1)
    draws = statistics.shape[1]
    for rank in range(int(np.ceil(confidence * draws)) - 1, draws):
        if np.mean((statistics <= ordered[:, rank, None]).all(axis=0)) >= confidence:
            break
    return ordered[:, rank]
