"""Constants of an arm that hold in every posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.robots import AbstractRobot, Articulated, Load

from ..verdict import Assumption
from .evaluated import Floats, mass_and_bias
from .series import Grid, Series, require_independent_joints
from .supremum import spectral, spectral_of_each, supremum


@dataclass(frozen=True)
class ArmConstants:
    """What holds of `M(q) q̈ + C(q,q̇) q̇ + G(q)` for every q; for arms with joints that slide, within their way.

    - `inertia_max`: bound of λmax(M).
    - `inertia_min`: bound of λmin(M) from below; 0 where none is known.
    - `weight`: bounds of |G_i| [n], N m or N.
    - `mass_slope`: L with `‖M(p) - M(q)‖ <= L ‖p - q‖`.
    - `weight_slope`: the same of G.
    - `coriolis`: c with `‖C(q,q̇) q̇‖ <= c ‖q̇‖²`.
    - `seen`: the extreme eigenvalues of M on the grid: the bounds cannot be better.
    - `assumptions`: how they were found.
    """

    inertia_max: float
    inertia_min: float
    weight: Floats
    mass_slope: float
    weight_slope: float
    coriolis: float
    seen: tuple[float, float]
    assumptions: Sequence[Assumption]


def arm_constants(
    robot: AbstractRobot, load: Load | None = None, *, lower: Floats | None = None, upper: Floats | None = None
) -> ArmConstants:
    """The constants of one arm, proved by its trigonometric series (docs/certificates/arm.md).

    - `robot`: whose; friction is not in them.
    - `load`: what it carries, counted as carried; None for nothing.
    - `lower`, `upper`: ends of prismatic joints [n], m; ±.5 m if not given.

    Raises DefinitionError if M depends on more than seven joints.
    """
    mass, weight = series_of(robot, load, lower, upper)
    n = robot.joints
    grid = mass.grid
    sampled = np.linalg.eigvalsh(mass_and_bias(robot, load, *_states(load, grid.postures))[0])
    low, high = float(sampled[:, 0].min()), float(sampled[:, -1].max())
    # ‖M - c‖ with c in the middle bounds both ends, and its grid has less to be wrong by than M itself.
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
        seen=(low, high),
        assumptions=(Assumption(text, "proved", reach.factor),),
    )


def series_of(
    robot: AbstractRobot, load: Load | None = None, lower: Floats | None = None, upper: Floats | None = None
) -> tuple[Series, Series]:
    """The series of M and of G.

    - `robot`, `load`, `lower`, `upper`: as in `arm_constants`.

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
    found = np.zeros(series.grid.size)
    for at, joint in enumerate(series.grid.joints):
        k = np.abs(series.grid.degrees[:, at])
        weight = k if series.grid.turns[joint] else 4.0 * (k > 0) / series.grid.half[joint]
        found[joint] = float((weight * sizes).sum())
    return found
