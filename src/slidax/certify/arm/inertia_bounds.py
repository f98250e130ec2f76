"""Bounds of an arm's inertia matrix M and gravity torque G in every posture, from their trigonometric series."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.mismatch import TimedPayload
from slidax.core.errors import DefinitionError

from ..certificate import Assumption
from ..sampled_scenario import Flags, Floats
from .arm_motion import mass_and_bias

POINTS = 5
"""Number of grid points for each joint: one more than twice the degree of M, which is 2."""

MOST = 7
"""Largest number of joints on which M and G may depend: 5⁷ postures are 78 125."""


@dataclass(frozen=True)
class TrigonometricSeries:
    """`f(q) = Σ c_k exp(i k·θ)`, with k from -2 to 2 for each joint on which f depends.

    θ is q for a revolute joint; a prismatic joint has `q = middle + half cos θ` (`PostureGrid`).

    - `grid`: the grid that determines the coefficients. `coefficients`: c_k [K ...].
    """

    grid: PostureGrid
    coefficients: Any


@dataclass(frozen=True)
class PostureGrid:
    """Grid of postures. The values of M and G on the grid determine M and G in every posture.

    - `joints`: the joints on which M and G depend.
    - `revolute`: True for each revolute joint [n].
    - `middle`, `half`: middle and half width of each prismatic joint's range [n], m; 0 and 1 for a revolute joint.
    """

    joints: tuple[int, ...]
    revolute: Floats
    middle: Floats
    half: Floats

    @classmethod
    def of(cls, at: Callable[[Floats], Floats], units: tuple[str, ...], lower: Floats, upper: Floats) -> PostureGrid:
        """Return the grid for a function of the posture. Random postures show on which joints the function depends.

        - `at`: maps postures [postures n] to function values [postures F].
        - `lower`, `upper`: limits of the prismatic joints [n], m; the entries of revolute joints are not used.

        Raises DefinitionError if the function depends on too many joints.
        """
        revolute = np.array([unit == "rad" for unit in units])
        n = len(revolute)
        middle = np.where(revolute, 0.0, 0.5 * (lower + upper))
        half = np.where(revolute, 1.0, np.maximum(0.5 * (upper - lower), 1e-6))
        random = np.random.default_rng(3)
        scaled = np.where(revolute, random.uniform(-np.pi, np.pi, (2, 4, n)), random.uniform(-1.0, 1.0, (2, 4, n)))
        q, other = middle + half * scaled
        postures = np.repeat(q[None], n + 1, axis=0)
        for joint in range(n):
            postures[joint + 1, :, joint] = other[:, joint]
        values = at(postures.reshape(-1, n)).reshape(n + 1, -1)
        change = np.abs(values[1:] - values[0]).max(axis=1)
        joints = tuple(np.flatnonzero(change > 1e-12 * max(float(np.abs(values).max()), 1e-300)).tolist())
        if len(joints) > MOST:
            raise DefinitionError(
                f"the arm's inertia matrix or gravity torque depends on {len(joints)} joints, and bounds over all "
                f"postures are computed for at most {MOST}"
            )
        return cls(joints, revolute, middle, half)

    @property
    def size(self) -> int:
        """Number n of joints of the arm."""
        return len(self.revolute)

    @property
    def postures(self) -> Floats:
        """All postures of the grid [5^J n], for J joints on which M and G depend."""
        angles = np.array(list(product(2.0 * np.pi * np.arange(POINTS) / POINTS, repeat=len(self.joints))))
        q = np.tile(self.middle, (len(angles), 1))
        for k, joint in enumerate(self.joints):
            q[:, joint] = (
                angles[:, k] if self.revolute[joint] else self.middle[joint] + self.half[joint] * np.cos(angles[:, k])
            )
        return q

    @property
    def degrees(self) -> Floats:
        """Wave numbers k of each coefficient [5^J J]."""
        harmonics = np.fft.fftfreq(POINTS, 1.0 / POINTS)
        count = len(self.joints)
        # numpy cannot infer the length if there are no joints.
        return np.array(list(product(harmonics, repeat=count))).reshape(POINTS**count, count)

    def series(self, values: Floats) -> TrigonometricSeries:
        """Return the series of a function, from its values at the postures [5^J ...]."""
        axes = tuple(range(len(self.joints)))
        shaped = values.reshape(*[POINTS] * len(self.joints), *values.shape[1:])
        coefficients = np.fft.fftn(shaped, axes=axes) / len(values) if axes else shaped[None]
        return TrigonometricSeries(self, coefficients.reshape(len(values), *values.shape[1:]))


def require_independent_joints(robot: AbstractRobot) -> None:
    """Raise DefinitionError for an arm with coupled joints.

    There M is not a polynomial of degree 2 in cosine and sine of each joint: a follower that turns twice as fast as its
    leader doubles the degree, and with one that turns half as fast M is not a polynomial.
    """
    if isinstance(robot, Coupled):
        raise DefinitionError(
            f"joint `{robot.followers[0]}` of {robot.name} follows another joint: bounds of M exist only for arms "
            "without coupled joints, where M is a polynomial of degree 2 in cosine and sine of each joint"
        )


MOST_NUMBERS = 6_000_000
"""Largest number of matrix entries on a grid, for all of its points together."""

MOST_POINTS = 720
"""Largest number of grid points of a joint."""

MOST_FACTOR = 20.0
"""Largest factor from a grid's maximum to the bound. For a coarser grid `Σ ‖c_k‖` is the bound."""

WORTH = 0.02
"""The terms that a joint adds are bounded on a further grid if their share of the total variation is above this."""


@dataclass(frozen=True)
class Supremum:
    """Upper bound of a norm over all postures, and the largest value on the grid from which it follows.

    - `upper`: the bound.
    - `sampled`: the largest value on the grid. The supremum is at least this value if the grid has all joints.
    - `points`: number of grid points for each joint of the grid.
    - `factor`: factor from the largest value on the grid to a bound between its points.
    """

    upper: float
    sampled: float
    points: int
    factor: float


def supremum(
    series: TrigonometricSeries, degree: int, size: Callable[[Floats], Floats], terms: Callable[[Any], Floats]
) -> Supremum:
    """Return a bound of `max_q ‖f(q)‖` over all postures q, for a function f as a series.

    - `series`: f, a scalar, vector or matrix.
    - `degree`: degree of f in each joint, 1 or 2.
    - `size`: maps values [P ...] to their norms [P].
    - `terms`: maps complex coefficients [K ...] to their norms [K].
    """
    joints = len(series.grid.joints)
    weights = terms(series.coefficients)
    degrees = np.abs(series.grid.degrees)
    entries = int(np.prod(series.coefficients.shape[1:], dtype=int))
    # Joints with the largest effect come first.
    order = np.argsort([-float(weights[degrees[:, at] > 0].sum()) for at in range(joints)], kind="stable").tolist()
    # For each joint, the terms that contain it and otherwise only joints before it in this order.
    added = [_only(degrees, order[: k + 1]) & (degrees[:, order[k]] > 0) for k in range(joints)]
    sums = [float(weights[terms].sum()) for terms in added]
    variation = sum(sums)
    count = min(range(joints + 1), key=lambda k: _factor(k, entries, degree) * 0.5 * sum(sums[:k]) + sum(sums[k:]))
    points, factor = _points(count, entries), _factor(count, entries, degree)
    sampled = _largest(series, _only(degrees, order[:count]), sorted(order[:count]), points, size)
    upper = factor * sampled
    for k in range(count, joints):
        factor_of_joint = _factor(k + 1, entries, degree)
        if sums[k] > WORTH * variation and factor_of_joint < MOST_FACTOR:
            largest = _largest(series, added[k], sorted(order[: k + 1]), _points(k + 1, entries), size)
            upper += min(factor_of_joint * largest, sums[k])
        else:
            upper += sums[k]
    return Supremum(upper, sampled, points, factor)


def _only(degrees: Floats, joints: Sequence[int]) -> Flags:
    """Return True for each coefficient whose term depends on no other joints than `joints` [K]."""
    others = [at for at in range(degrees.shape[1]) if at not in joints]
    return ~degrees[:, others].any(axis=1)


def _factor(count: int, entries: int, degree: int) -> float:
    points = _points(count, entries)
    return math.cos(degree * math.pi / points) ** -count if points > 2 * degree else math.inf


def _points(count: int, entries: int) -> int:
    if count == 0:
        return MOST_POINTS
    return min(MOST_POINTS, int((MOST_NUMBERS / entries) ** (1.0 / count)))


def _largest(
    series: TrigonometricSeries, terms: Flags, kept: Sequence[int], points: int, size: Callable[[Floats], Floats]
) -> float:
    """Return the largest norm of the sum of `terms` on a grid of the joints `kept`; `terms` depend on these alone."""
    joints = len(series.grid.joints)
    shape = series.coefficients.shape[1:]
    coefficients = np.where(terms.reshape(-1, *[1] * len(shape)), series.coefficients, 0.0)
    coefficients = coefficients.reshape(*[POINTS] * joints, *shape)
    # The constant term is the first along each axis.
    partial = coefficients[tuple(slice(None) if at in kept else 0 for at in range(joints))]
    if not kept:
        return float(size(partial.real[None]).max())
    angles = 2.0 * np.pi * np.arange(points) / points
    waves = np.exp(1j * np.outer(angles, np.fft.fftfreq(POINTS, 1.0 / POINTS)))
    # Evaluate joint by joint, and the first joint in the loop below: all postures would not fit in memory at once.
    for axis in range(1, len(kept)):
        partial = np.moveaxis(np.tensordot(waves, partial, axes=(1, axis)), 0, axis)
    flat = partial.reshape(POINTS, -1)
    largest = 0.0
    for wave in waves:
        values = (wave.real @ flat.real - wave.imag @ flat.imag).reshape(-1, *shape)
        largest = max(largest, float(size(values).max()))
    return largest


def spectral_norm(values: Any) -> Floats:
    """Return spectral norms of matrices [P n n], of which only the largest one is needed [P].

    A matrix gets 0 if its Frobenius norm, which is an upper bound, is below a spectral norm already computed.
    """
    frobenius: Floats = np.sqrt((np.abs(values) ** 2).sum(axis=(1, 2)))
    order = np.argsort(-frobenius)
    norms = np.zeros(len(values))
    best = 0.0
    for k in range(0, len(order), 256):
        some = order[k : k + 256]
        if frobenius[some[0]] <= best:
            break
        norms[some] = np.linalg.norm(values[some], ord=2, axis=(1, 2))
        best = max(best, float(norms[some].max()))
    return norms


def spectral_norms(values: Any) -> Floats:
    """Return the spectral norm of each of some real or complex matrices [P n n]."""
    return np.linalg.norm(values, ord=2, axis=(1, 2))


@dataclass(frozen=True)
class ArmConstants:
    """Bounds for `M(q) q̈ + C(q,q̇) q̇ + G(q)` at every q, with prismatic joints within their range.

    - `inertia_max`: upper bound of λmax(M).
    - `inertia_min`: lower bound of λmin(M); 0 if none is known.
    - `weight`: bounds of |G_i| [n], N m or N.
    - `mass_slope`: L with `‖M(p) - M(q)‖ <= L ‖p - q‖`; `weight_slope`: the same for G.
    - `coriolis`: c with `‖C(q,q̇) q̇‖ <= c ‖q̇‖²`.
    - `sampled`: least and largest eigenvalue of M on the grid; valid bounds enclose these two values.
    """

    inertia_max: float
    inertia_min: float
    weight: Floats
    mass_slope: float
    weight_slope: float
    coriolis: float
    sampled: tuple[float, float]
    assumptions: Sequence[Assumption]


def arm_constants(
    robot: AbstractRobot, load: TimedPayload | None = None, *, lower: Floats | None = None, upper: Floats | None = None
) -> ArmConstants:
    """Return the constants of one arm, proved by its trigonometric series (docs/certificates/reference.md).

    - `robot`: the arm; its friction is not included.
    - `load`: a payload that is always carried, or None.
    - `lower`, `upper`: limits of prismatic joints [n], m; ±0.5 m by default.

    Raises DefinitionError if joints are coupled, or M or G depends on more than seven joints.
    """
    mass, weight = inertia_and_weight_series(robot, load, lower, upper)
    n = robot.joints
    grid = mass.grid
    sampled = np.linalg.eigvalsh(mass_and_bias(robot, load, *_states(load, grid.postures))[0])
    low, high = float(sampled[:, 0].min()), float(sampled[:, -1].max())
    # ‖M - c‖ with c in the middle bounds both extremes, and its grid error is smaller than that of ‖M‖.
    middle = 0.5 * (low + high)
    shifted = TrigonometricSeries(
        grid, mass.coefficients - middle * np.eye(n) * (grid.degrees == 0).all(axis=1)[:, None, None]
    )
    radius = supremum(shifted, 2, spectral_norm, spectral_norms)
    rotors = float(np.asarray(robot.armature).min()) if isinstance(robot, Articulated) else 0.0
    weights: Floats = np.array(
        [
            supremum(
                TrigonometricSeries(grid, weight.coefficients[:, i : i + 1]),
                1,
                lambda x: np.abs(x[:, 0]),
                lambda c: np.abs(c[:, 0]),
            ).upper
            for i in range(n)
        ]
    )
    of_mass = _slopes(mass, spectral_norms(mass.coefficients))
    of_weight = _slopes(weight, np.linalg.norm(weight.coefficients, axis=1))
    slope = float(np.linalg.norm(of_mass))
    text = (
        f"M and G are trigonometric polynomials in {len(grid.joints)} of {n} joints, of degree 2 and 1: "
        f"{radius.points} points a joint bound them everywhere, with the factor {radius.factor:.3g}"
    )
    return ArmConstants(
        inertia_max=middle + radius.upper,
        inertia_min=max(middle - radius.upper, rotors, 0.0),
        weight=weights,
        mass_slope=slope,
        weight_slope=float(np.linalg.norm(of_weight)),
        coriolis=1.5 * slope,
        sampled=(low, high),
        assumptions=(Assumption(text, "proved", radius.factor),),
    )


def inertia_and_weight_series(
    robot: AbstractRobot, load: TimedPayload | None = None, lower: Floats | None = None, upper: Floats | None = None
) -> tuple[TrigonometricSeries, TrigonometricSeries]:
    """Return the series of the inertia matrix M and of the gravity torque G, as functions of the posture.

    - `load`, `lower`, `upper`: as in `arm_constants`.

    Raises DefinitionError as `arm_constants` does.
    """
    require_independent_joints(robot)
    n = robot.joints
    lower = np.full(n, -0.5) if lower is None else lower
    upper = np.full(n, 0.5) if upper is None else upper

    def flat(q: Floats) -> Floats:
        mass, bias = mass_and_bias(robot, load, *_states(load, q))
        return np.concatenate([mass.reshape(len(q), -1), bias], axis=1)

    grid = PostureGrid.of(flat, robot.joint_units, lower, upper)
    mass, weight = mass_and_bias(robot, load, *_states(load, grid.postures))
    return grid.series(mass), grid.series(weight)


def _states(load: TimedPayload | None, q: Floats) -> tuple[Floats, Floats, Floats]:
    return np.full(len(q), 0.0 if load is None else float(load.attached)), q, np.zeros_like(q)


def _slopes(series: TrigonometricSeries, sizes: Floats) -> Floats:
    """Return bounds of ‖∂f/∂q_j‖ [n], from ‖c_k‖ [K]."""
    bounds = np.zeros(series.grid.size)
    for at, joint in enumerate(series.grid.joints):
        k = np.abs(series.grid.degrees[:, at])
        weight = k if series.grid.revolute[joint] else 4.0 * (k > 0) / series.grid.half[joint]
        bounds[joint] = float((weight * sizes).sum())
    return bounds
