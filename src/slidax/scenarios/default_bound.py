"""How large the robust torque is where a file does not say so: by the arm, its drives and the stated mismatch."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionWarning, is_traced
from slidax._types import State
from slidax.actuators import TorqueLimits
from slidax.parts import kind_of
from slidax.reaching import UncertaintyBound
from slidax.robots import AbstractRobot, Articulated, Coupled, JointLimits, Load
from slidax.simulation.states import Numbers, spread, states_of

POSTURES = 256

LEAST, MOST = 0.2, 0.5
"""γ of the printed law is no less, as no model is better known, and no more: u grows as 1/(1 - γ)."""

MARGIN = 0.2
"""k over the norm of the torque limits, or of the weight where there are none."""

CEILING = 0.25
"""What a sampled-data law may make up for, over the norm of the torque limits: an estimate that asks for more while the
drives are at their limits runs away. The Panda with 2 kg holds with .23, and not with .46."""

FAR_BELOW = 0.1
"""Of the norm of the torque limits: a bound above it is not looked at any closer."""

RANGE = {"rad": np.pi, "m": 0.5}
"""To both sides, where the robot has no ends, rad or m."""


def default_bound(
    true: AbstractRobot, nominal: AbstractRobot, load: Load | None, drives: TorqueLimits, *, sampled: bool
) -> dict[str, float]:
    """The numbers of an `UncertaintyBound`, eqs. (19), (45) to (47), by 256 postures over the joints' ranges.

    With the true M and `b = C q̇ + G`, the nominal M0 and b0, the lumped uncertainty is
    `(M0 M⁻¹ - I)(τ - b) - (b - b0)`. Let `B = max‖b - b0‖` at rest, with friction at 1 rad/s, or 20 % of the weight if
    that is more. `b1 = 0`, as weight does not grow with ‖q‖, and k is 20 % of the norm of the torque limits.

    - As it is printed: γ bounds `|κ - 1|` of the eigenvalues κ of `M⁻¹M0`, between .2 and .5; `m1, m2 = (1 ∓ γ) m` with
      `m = mean ‖M0⁻¹‖` have this γ by (46); `b0 = γ max‖G0‖ + (1 + γ) B`, and b2 is the same share of `C q̇` over ‖q̇‖².
    - In sampled-data form the estimate follows what the inertia misses: `γ = 0` and `b2 = 0`; `b0 = B`, but `k + b0` is
      no more than a quarter of the norm of the torque limits.

    - `true`, `nominal`: the arm that moves, and as the law knows it.
    - `load`: what the true one carries.
    - `drives`: their limits.
    - `sampled`: whether the law is in sampled-data form.
    """
    lower, upper = _box(nominal)
    n = len(lower)
    q = spread(lower, upper, POSTURES)
    known, moved = states_of(nominal, q), states_of(_carrying(true, load), q)
    weight = _largest(known.bias)
    differs = _largest(moved.bias - known.bias) + float(np.linalg.norm(_friction(true) - _friction(nominal)))
    missed = max(differs, LEAST * weight)
    torque = np.broadcast_to(np.asarray(drives.torque), n)
    strength = float(np.linalg.norm(torque)) if np.isfinite(torque).all() else np.inf
    margin = max(MARGIN * (strength if np.isfinite(strength) else weight), 1e-3)
    inverse = float(np.mean(1.0 / np.linalg.eigvalsh(known.mass)[:, 0]))
    if sampled:
        gamma, b0, b2 = 0.0, min(missed, CEILING * strength - margin), 0.0
    else:
        kappa = np.linalg.eigvals(np.linalg.solve(moved.mass, known.mass)).real
        gamma = float(np.clip(np.abs(kappa - 1.0).max(), LEAST, MOST))
        b0 = gamma * weight + (1.0 + gamma) * missed
        dq = spread(-np.ones(n), np.ones(n), POSTURES)
        speeding = states_of(nominal, q, dq).bias - known.bias
        b2 = (gamma + (1.0 + gamma) * LEAST) * _largest(speeding / np.sum(dq * dq, axis=1, keepdims=True))
    found = {
        "inverse_inertia_min": (1.0 - gamma) * inverse,
        "inverse_inertia_max": (1.0 + gamma) * inverse,
        "b0": b0,
        "b1": 0.0,
        "b2": b2,
        "margin": margin,
    }
    return {name: float(f"{value:.4g}") for name, value in found.items()}


def warn_of_another_arms(
    given: dict[str, Any], state: State, drives: TorqueLimits, find: Callable[[], dict[str, float]]
) -> None:
    """One DefinitionWarning, with numbers, if u at the start at rest cannot be meant for this arm.

    That is above the norm of the torque limits, or below a tenth of it and also below a third of the `k + b0` that
    would be found. Nothing is said of other kinds of bounds, without torque limits, or of numbers not known yet.

    - `given`: the numbers of the bound, with its `kind`.
    - `state`: the start.
    - `drives`: their limits.
    - `find`: the numbers that would be found.
    """
    if is_traced((list(given.values()), state, drives)):
        return
    torque = np.broadcast_to(np.asarray(drives.torque), state.q.shape)
    least, most = given.get("inverse_inertia_min"), given.get("inverse_inertia_max")
    if given["kind"] != kind_of(UncertaintyBound) or not np.isfinite(torque).all():
        return
    if least is None or most is None or not 0.0 < least <= most:
        return
    gamma = (most - least) / (most + least)
    u = (given["margin"] + given["b0"] + given["b1"] * float(np.linalg.norm(np.asarray(state.q)))) / (1.0 - gamma)
    strength = float(np.linalg.norm(torque))
    remedy = "leave `scheme.bound` out, and it is found for this arm"
    if u > strength:
        said = f"u = {u:.3g} N m at the start, more than all drives together can give (norm {strength:.3g} N m)"
    elif u < FAR_BELOW * strength and (needed := sum(find()[name] for name in ("margin", "b0"))) > 3.0 * u:
        said = f"u = {u:.3g} N m at the start, where this arm and its stated mismatch ask for {needed:.3g} N m"
    else:
        return
    warnings.warn(f"scheme.bound gives {said}; is it another arm's? {remedy}", DefinitionWarning, stacklevel=2)


def _carrying(true: AbstractRobot, load: Load | None) -> AbstractRobot:
    if isinstance(true, Coupled) and load is not None:
        return eqx.tree_at(lambda one: one.arm.payload, true, load.payload)
    if load is None or not isinstance(true, Articulated):
        return true
    return eqx.tree_at(lambda arm: arm.payload, true, load.payload)


def _box(robot: AbstractRobot) -> tuple[Numbers, Numbers]:
    reach = np.array([RANGE[unit] for unit in robot.joint_units])
    limits: JointLimits | None = robot.limits if isinstance(robot, Articulated | Coupled) else None
    if limits is None:
        return -reach, reach
    lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
    return np.where(np.isfinite(lower), lower, -reach), np.where(np.isfinite(upper), upper, reach)


def _friction(robot: AbstractRobot) -> Numbers:
    """Of a joint at 1 rad/s or m/s [n]."""
    if isinstance(robot, Articulated | Coupled):
        return np.asarray(robot.coulomb) + np.asarray(robot.viscous)
    return np.zeros(robot.joints)


def _largest(vectors: Numbers) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())
