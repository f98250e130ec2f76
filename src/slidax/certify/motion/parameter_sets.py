"""Uncertainty sets of masses, inertias and rotors, as a region of the true arm's inertial parameters.

The inertial parameters φ are affine in masses, in inertias about fixed centres, and in rotor inertias. So over a box of
such values `φ = φ_m + Σ_k ξ_k D_k` with |ξ_k| <= 1, for the middle φ_m and a row D_k for each value. Let M(D) and J(D)
be the inertia matrix and a body's pseudo-inertia for the parameters D, and ΔM and ΔJ_b their errors. A row that only
adds mass has `M(D_k) >= 0` for every q. If this holds for all rows,

1. `-M(Σ D_k) <= ΔM <= M(Σ D_k)`, so that one p holds for all rows together;
2. `-Σ J(D_k) <= ΔJ_b <= Σ J(D_k)` for each body;
3. `Σ ξ_k D_k` is in the ellipsoid of the rows `D_k/√w_k` with `Σ w_k = 1`, since `Σ w_k ξ_k² <= 1`.

`w_k` is in proportion to the size of D_k. So a row that is split into equal parts counts as one row, and a row of zeros
does not count.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np
from numpy.typing import NDArray

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.mismatch import TimedPayload
from slidax.arms.paper_arms import Scara, TwoLink
from slidax.core.errors import DefinitionError
from slidax.identify.band import arm_parameters
from slidax.identify.mass_bound import MassBound
from slidax.identify.regressor import BODY
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertain_values import with_values
from slidax.scenarios.uncertainty import INERTIAL_PATH
from slidax.simulation.plant import Plant

from ..uncertainty_set import UncertainValue, family_of, set_ends, uncertain_values
from .body_points import points_of, pseudo_inertias
from .parameter_region import ParameterRegion, ball_region

Floats = NDArray[np.float64]

INERTIAL = tuple(
    f"robot.plant.{name}" for name in ("mass_factor", "inertia_factor", "armature", "load", "masses", "inertias")
)
"""Paths of a scenario whose values change inertial parameters."""

POINTS = 3
"""Random points of a box at which the affine map is checked against the arm itself."""

ROUNDING = 1e-9


def numbers_regions(scenario: Scenario, arm: Articulated, plant: Plant) -> list[ParameterRegion]:
    """Return the regions of the true arm's uncertainty sets and of its known difference from the nominal arm.

    The true arm's parameter error is a sum of errors, one from each region (`joined_regions`). The list is empty if the
    true arm is the nominal arm.

    - `arm`: the nominal arm. `plant`: the plant; its values may be any in the sets.

    Raises DefinitionError if inertial parameters are not affine in a value, or a payload is attached or released during
    the motion.
    """
    family = family_of(scenario)
    sets = {} if family is None else {k: each for k, each in family.space.sets.items() if k.startswith(INERTIAL)}
    nominal = arm_parameters(arm)
    size = np.maximum(np.abs(nominal), ROUNDING)
    if family is None or not sets:
        offset, rows = true_parameters(plant.robot, plant.load) - nominal, np.zeros((0, nominal.size))
    else:
        axes = [axis for path, each in sets.items() for axis in uncertain_values(path, each, family.space.leaves[path])]
        middle, rows = _affine(family, axes)
        offset = middle - nominal
    bound = MassBound(arm, nominal)
    regions = []
    if len(rows):
        regions.append(_box_region(bound, rows))
    if np.max(np.abs(offset) / size) > 1e-12:
        title = "the known difference of their middle" if regions else "a known difference"
        regions.append(ball_region(arm, offset[None], float(bound.of(offset[None])[0]), title))
    return regions


def rigid_links(robot: Any) -> Articulated:
    """Return an arm as an `Articulated` arm; the paper's built-in arms are converted.

    Raises DefinitionError for an arm that does not consist of rigid links.
    """
    if isinstance(robot, TwoLink | Scara):
        return _chain(robot)
    if not isinstance(robot, Articulated):
        raise DefinitionError(f"a bound along a motion needs an arm of rigid links; got a {type(robot).__name__}")
    return robot


@eqx.filter_jit
def _chain(robot: TwoLink | Scara) -> Articulated:
    # Compiled, which is ten times as fast: an uncertainty set needs hundreds of arms.
    return robot.rigid_links()


def true_parameters(robot: AbstractRobot, load: TimedPayload | None) -> Floats:
    """Return the inertial parameters of a true arm with its payload [11n]: ten per body, then the rotors' inertias.

    - `load`: a payload in addition to the arm's own; None without one.

    Raises DefinitionError if the payload is attached or released during the motion, or the arm does not consist of
    rigid links.
    """
    links = rigid_links(robot)
    if load is not None:
        if float(load.attached) > 0.0 or np.isfinite(float(load.released)):
            raise DefinitionError(
                "a payload that is attached or released during a motion is not covered: set "
                "`robot.plant.load.attached: 0` and leave out `released`, or certify the motions before and after"
            )
        links = eqx.tree_at(lambda arm: arm.payload, links, links.payload.joined(load.payload))
    return arm_parameters(links)


def _affine(family: Family, axes: list[UncertainValue]) -> tuple[Floats, Floats]:
    """Return φ in the middle of the box [11n], and the row D_k of each axis [K 11n].

    Raises DefinitionError if φ is not affine in the axes.
    """
    numbers = {path: each for path, each in family.space.sets.items() if path != INERTIAL_PATH}
    ends = {path: set_ends(each, family.space.leaves[path]) for path, each in numbers.items()}
    middle = {path: 0.5 * (low + high) for path, (low, high) in ends.items()}
    actual = family.case(middle).as_it_is()

    def parameters(signs: Floats) -> Floats:
        values = {path: np.array(value) for path, value in middle.items()}
        for axis, sign in zip(axes, signs, strict=True):
            share = np.array([0.5 * (1.0 + sign)])
            values[axis.path] = axis.moved(values[axis.path][None], share)[0]
        arms = with_values(actual, values).robot.build()
        return true_parameters(arms.true, arms.load)

    count = len(axes)
    base = parameters(np.zeros(count))
    rows = np.stack([0.5 * (parameters(unit) - parameters(-unit)) for unit in np.eye(count)])
    # φ is a polynomial in the values. A polynomial that agrees with an affine map at a generic point is that map.
    for signs in np.random.default_rng(0).uniform(-1.0, 1.0, (POINTS, count)):
        apart = np.abs(parameters(signs) - base - signs @ rows)
        if np.any(apart > ROUNDING * (np.abs(base) + np.abs(rows).sum(axis=0) + ROUNDING)):
            paths = ", ".join(dict.fromkeys(f"`{axis.path}`" for axis in axes))
            raise DefinitionError(
                f"the inertial parameters are not affine in {paths}, as in a payload's centre: leave "
                f"those sets out and set `uncertainty.{INERTIAL_PATH}: {{band: 0.03}}`"
            )
    return base, rows


def _box_region(bound: MassBound, rows: Floats) -> ParameterRegion:
    """Return the region of parameter errors `Σ ξ_k D_k` with |ξ_k| <= 1.

    - `bound`: computes p of a row. `rows`: D_k [K 11n].
    """
    n = rows.shape[1] // (BODY + 1)
    bodies, rotors = pseudo_inertias(rows[:, : BODY * n]), rows[:, BODY * n :]
    # Rows that take mass away change their sign.
    turned = np.where(np.trace(bodies.sum(axis=1), axis1=1, axis2=2) + rotors.sum(axis=1) < 0.0, -1.0, 1.0)
    rows, bodies, rotors = rows * turned[:, None], bodies * turned[:, None, None, None], rotors * turned[:, None]
    least = np.linalg.eigvalsh(bodies).min(axis=(1, 2))
    largest = np.abs(bodies).max(axis=(1, 2, 3))
    if np.any(least < -ROUNDING * largest) or np.any(rotors < 0.0):
        raise DefinitionError(
            "an uncertain value increases one inertia and decreases another, and a bound along a motion does not cover "
            f"such a value: set `uncertainty.{INERTIAL_PATH}: {{band: 0.03}}` instead"
        )
    sizes = bound.of(rows, refine=False)
    rows_of = np.sqrt(np.sum(sizes) / sizes)
    p = float(bound.of(rows.sum(axis=0)[None])[0])
    return ParameterRegion(
        p=p,
        points=points_of(bodies.sum(axis=0)),
        rotors=rotors.sum(axis=0),
        deviations=bodies * rows_of[:, None, None, None],
        rotor_deviations=rotors * rows_of[:, None],
        title="the uncertainty sets of the true arm's inertial parameters",
    )
