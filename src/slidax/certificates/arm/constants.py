"""Constants of an arm that hold in every posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.robots import AbstractRobot, Articulated, Load

from ..each import Floats
from ..verdict import Assumption
from .evaluated import mass_and_bias
from .series import Grid, Series, require_independent_joints
from .supremum import spectral, spectral_of_each, supremum


@dataclass(frozen=True)
class ArmConstants:
    """Bounds for `M(q) q̈ + C(q,q̇) q̇ + G(q)` at every q; prismatic joints stay within their range.

    - `inertia_max`: upper bound of λmax(M).
    - `inertia_min`: lower bound of λmin(M); 0 if none is known.
    - `weight`: bounds of |G_i| [n], N m or N.
    - `mass_slope`: L with `‖M(p) - M(q)‖ <= L ‖p - q‖`; `weight_slope`: the same for G.
    - `coriolis`: c with `‖C(q,q̇) q̇‖ <= c ‖q̇‖²`.
    - `sampled`: extreme eigenvalues of M on the grid: no bound can be better.
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
    robot: AbstractRobot, load: Load | None = None, *, lower: Floats | None = None, upper: Floats | None = None
) -> ArmConstants:
    """Return the constants of one arm, proved by its trigonometric series (docs/certificates/arm.md).

    - `robot`: its friction is not included.
    - `load`: a payload, always carried; None for none.
    - `lower`, `upper`: limits of prismatic joints [n], m; ±0.5 m by default.

    Raises DefinitionError if M depends on more than seven joints.
    """
    mass, weight = series_of(robot, load, lower, upper)
    n = robot.joints
    grid = mass.grid
    sampled = np.linalg.eigvalsh(mass_and_bias(robot, load, *_states(load, grid.postures))[0])
    low, high = float(sampled[:, 0].min()), float(sampled[:, -1].max())
    # ‖M - c‖ with c in the middle bounds both ends, and its grid error is smaller than M's.
    middle = 0.5 * (low + high)
    shifted = Series(grid, mass.coefficients - middle * np.eye(n) * (grid.degrees == 0).all(axis=1)[:, None, None])
    reach = supremum(shifted, 2, spectral, spectral_of_each)
    rotors = float(np.asarray(robot.armature).min()) if isinstance(robot, Articulated) else 0.0
    weights: Floats = np.array(
        [
            supremum(
                Series(grid, weight.coefficients[:, i : i + 1]), 1, lambda x: np.abs(x[:, 0]), lambda c: np.abs(c[:, 0])
            ).upper
            for i in range(n)
        ]
    )
    of_mass = _slopes(mass, spectral_of_each(mass.coefficients))
    of_weight = _slopes(weight, np.linalg.norm(weight.coefficients, axis=1))
    slope = float(np.linalg.norm(of_mass))
    text = (
        f"M and G are trigonometric polynomials in {len(grid.joints)} of {n} joints, of degree 2 and 1: {reach.points} "
        f"points a joint bound them everywhere, with the factor {reach.factor:.3g}"
    )
    return ArmConstants(
        inertia_max=middle + reach.upper,
        inertia_min=max(middle - reach.upper, rotors, 0.0),
        weight=weights,
        mass_slope=slope,
        weight_slope=float(np.linalg.norm(of_weight)),
        coriolis=1.5 * slope,
        sampled=(low, high),
        assumptions=(Assumption(text, "proved", reach.factor),),
    )


def series_of(
    robot: AbstractRobot, load: Load | None = None, lower: Floats | None = None, upper: Floats | None = None
) -> tuple[Series, Series]:
    """Return the series of M and of G.

    Raises DefinitionError if M depends on more than seven joints.
    """
    require_independent_joints(robot)
    n = robot.joints
    lower = np.full(n, -0.5) if lower is None else lower
    upper = np.full(n, 0.5) if upper is None else upper

    def flat(q: Floats) -> Floats:
        mass, bias = mass_and_bias(robot, load, *_states(load, q))
        return np.concatenate([mass.reshape(len(q), -1), bias], axis=1)

    grid = Grid.of(flat, robot.joint_units, lower, upper)
    mass, weight = mass_and_bias(robot, load, *_states(load, grid.postures))
    return grid.series(mass), grid.series(weight)


def _states(load: Load | None, q: Floats) -> tuple[Floats, Floats, Floats]:
    return np.full(len(q), 0.0 if load is None else float(load.attached)), q, np.zeros_like(q)


def _slopes(series: Series, sizes: Floats) -> Floats:
    """Bounds of ‖∂f/∂q_j‖ [n], from ‖c_k‖ [K]."""
    bounds = np.zeros(series.grid.size)
    for at, joint in enumerate(series.grid.joints):
        k = np.abs(series.grid.degrees[:, at])
        weight = k if series.grid.turns[joint] else 4.0 * (k > 0) / series.grid.half[joint]
        bounds[joint] = float((weight * sizes).sum())
    return bounds
