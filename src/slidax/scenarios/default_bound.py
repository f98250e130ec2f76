"""Default uncertainty bound of a scheme, from the arm, its drives and the stated mismatch."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np

from slidax.arms.arm import AbstractRobot, JointLimits
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.mismatch import TimedPayload
from slidax.core.errors import DefinitionWarning, is_traced
from slidax.core.part import kind_of
from slidax.core.types import State
from slidax.law.torque_bounds import UncertaintyBound
from slidax.plant.actuators import TorqueLimits
from slidax.simulation.states import Numbers, spread_in_box, states_of

POSTURES = 256

LEAST, MOST = 0.2, 0.5
"""Smallest and largest γ of the printed law: no model is assumed to be more exact, and u grows as 1/(1 - γ)."""

MARGIN = 0.2
"""k as a share of the norm of the torque limits, or of the weight if there are no limits."""

CEILING = 0.25
"""Largest `k + b0` of a sampled-data law as a share of the norm of the torque limits: a larger estimate diverges while
the drives are at their limits. The Panda with 2 kg is stable with 0.23, but not with 0.46."""

FAR_BELOW = 0.1
"""Share of the norm of the torque limits: if u is below it, the bound may be too small."""

RANGE = {"rad": np.pi, "m": 0.5}
"""rad or m to both sides: assumed range of a joint without limits."""


def default_bound(
    true: AbstractRobot, nominal: AbstractRobot, load: TimedPayload | None, drives: TorqueLimits, *, sampled: bool
) -> dict[str, float]:
    """Return default parameters of an `UncertaintyBound`, by name.

    Equation numbers are the paper's. The true arm has the mass matrix M, the gravity torque G and `h = C q̇ + G`; M0,
    C0, G0 and h0 are the nominal arm's. Maxima and means are over 256 postures in the joints' ranges. The lumped
    uncertainty `(M0 M⁻¹ - I)(τ - h) - (h - h0)` has the bound `b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖`, eq. (19).

    - `B = max‖G - G0‖` plus the difference of the friction at 1 rad/s, but at least 20 % of `max‖G0‖`.
    - `b1 = 0`, since the gravity torque does not grow with ‖q‖.
    - `margin`, k: 20 % of the norm of the torque limits; without limits, 20 % of `max‖G0‖`.

    For a law in continuous time:
    - `γ = max|κ - 1|` over the eigenvalues κ of `M⁻¹M0`, limited to 0.2 ... 0.5.
    - Bounds of ‖M⁻¹‖: `(1 - γ) mean‖M0⁻¹‖` and `(1 + γ) mean‖M0⁻¹‖`, which give this γ by eq. (46).
    - `b0 = γ max‖G0‖ + (1 + γ) B`, and `b2 = (γ + 0.2 (1 + γ)) max‖C0 q̇‖/‖q̇‖²`.

    For a law in sampled-data form, whose estimator compensates the inertia mismatch:
    - `γ = b2 = 0`, so that both bounds of ‖M⁻¹‖ are `mean‖M0⁻¹‖`, and `b0 = B`, but `k + b0` is at most a quarter of
      the norm of the torque limits.

    - `true`, `nominal`: the true arm, and the arm that the law knows.
    - `load`: payload of the true arm; None for none.
    - `drives`: torque limits.
    - `sampled`: True for a law in sampled-data form, False for one in continuous time.
    """
    lower, upper = _box(nominal)
    n = len(lower)
    q = spread_in_box(lower, upper, POSTURES)
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
        dq = spread_in_box(-np.ones(n), np.ones(n), POSTURES)
        speeding = states_of(nominal, q, dq).bias - known.bias
        b2 = (gamma + (1.0 + gamma) * LEAST) * _largest(speeding / np.sum(dq * dq, axis=1, keepdims=True))
    bound = {
        "inverse_inertia_min": (1.0 - gamma) * inverse,
        "inverse_inertia_max": (1.0 + gamma) * inverse,
        "b0": b0,
        "b1": 0.0,
        "b2": b2,
        "margin": margin,
    }
    return {name: float(f"{value:.4g}") for name, value in bound.items()}


def warn_of_implausible_bound(
    bound: dict[str, Any], state: State, drives: TorqueLimits, find: Callable[[], dict[str, float]]
) -> None:
    """Warn, with a DefinitionWarning, if an uncertainty bound is implausible for this arm.

    The criterion is the robust torque for an arm at rest at the start, `u = (margin + b0 + b1‖q‖)/(1 - γ)`. A bound is
    implausible in two cases:
    - u exceeds the norm of the torque limits.
    - u is below a tenth of this norm, and below a third of the default `margin + b0`.

    Other kinds of bounds, traced values and arms without torque limits are not checked.

    - `bound`: parameters of the bound, with its `kind`.
    - `state`: the state at t = 0.
    - `drives`: torque limits.
    - `find`: function that returns the default parameters, as `default_bound` does.
    """
    if is_traced((list(bound.values()), state, drives)):
        return
    torque = np.broadcast_to(np.asarray(drives.torque), state.q.shape)
    least, most = bound.get("inverse_inertia_min"), bound.get("inverse_inertia_max")
    if bound["kind"] != kind_of(UncertaintyBound) or not np.isfinite(torque).all():
        return
    if least is None or most is None or not 0.0 < least <= most:
        return
    # 1/(1 - gamma), also where gamma rounds to 1.
    u = (bound["margin"] + bound["b0"] + bound["b1"] * float(np.linalg.norm(np.asarray(state.q)))) * (
        0.5 + 0.5 * most / least
    )
    strength = float(np.linalg.norm(torque))
    remedy = "leave `scheme.bound` out to compute it for this arm"
    if u > strength:
        value = f"u = {u:.3g} N m at the start, more than all drives together (norm {strength:.3g} N m)"
    elif u < FAR_BELOW * strength and (needed := sum(find()[name] for name in ("margin", "b0"))) > 3.0 * u:
        value = f"u = {u:.3g} N m at the start, but this arm and its stated mismatch need {needed:.3g} N m"
    else:
        return
    warnings.warn(
        f"scheme.bound, of the model error, gives {value}; is it for another arm? {remedy}",
        DefinitionWarning,
        stacklevel=2,
    )


def _carrying(true: AbstractRobot, load: TimedPayload | None) -> AbstractRobot:
    if isinstance(true, Coupled) and load is not None:
        return eqx.tree_at(lambda coupled: coupled.arm.payload, true, load.payload)
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
    """Friction of the joints at 1 rad/s or m/s [n]."""
    if isinstance(robot, Articulated | Coupled):
        return np.asarray(robot.coulomb) + np.asarray(robot.viscous)
    return np.zeros(robot.joints)


def _largest(vectors: Numbers) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())
