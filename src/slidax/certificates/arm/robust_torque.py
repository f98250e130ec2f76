"""The certificate `robust_torque`: the robust torque covers the torque that the model lacks."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import State
from slidax.controllers import SampledData
from slidax.diagnosis import Remedy
from slidax.reaching import AbstractBound, StateBound
from slidax.scenarios import Scenario

from ..certificate import ARM, certificate
from ..demand import Demand
from ..each import Floats
from ..verdict import Assumption, Verdict
from .demand import compute_demand
from .members import Members
from .motion import Belief, Motion

ROBUST_TORQUE = "robust_torque", "the robust torque is large enough"

REMEDY_FACTOR = 1.05
"""Factor of the required torque in a remedy."""


@certificate(*ROBUST_TORQUE, covers=(*ARM, "sensor", "actuator"))
def robust_torque(
    scenario: Scenario, demand: Demand | None = None, *, radius: Any = None, speed: Any = None
) -> Verdict:
    """Check `u >= ‖M0 w*‖` along the motion, for every member of the set: (44), (45), docs/sampled-data.md.

    A law in sampled-data form compensates no more than u covers, and `s⁺ = 0` holds only if u covers all of it.

    - `demand`: of the scenario's set; computed by default.
    - `radius`, `speed`: bounds of the error and of its rate, [n] or [N n]; adds the demand of such deviations.
    """
    bound = bound_of(scenario)
    if bound is None:
        return Verdict(*ROBUST_TORQUE, None, None, {}, (), f"`{scenario.scheme}` has no robust torque")
    demand = compute_demand(scenario) if demand is None else demand
    belief, motion = Belief.of(scenario, Members.of(scenario, None).plant), Motion.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)

    def lumped(w: Floats) -> Floats:
        return np.einsum("kij,...kj->...ki", mass, w)

    torque = demand.worst(lumped)
    if demand.jumps is not None:
        torque = torque + np.einsum("kij,kj->ki", np.abs(mass), demand.jumps)
    if radius is not None and demand.deviation is not None:
        torque = torque + np.einsum("kij,kj->ki", np.abs(mass), demand.deviation(radius, speed))
    lacks = np.linalg.norm(torque, axis=1)
    feedforward = np.einsum("kij,kj->ki", mass, motion.ddq) + bias
    u = np.asarray(_sizes(bound, jnp.asarray(motion.q), jnp.asarray(motion.dq), jnp.asarray(feedforward)))
    share = lacks / np.where(u > 0, u, 1e-300)
    k = int(np.argmax(share))
    needed, available = float(lacks[k]), float(u[k])
    holds = needed <= available
    there = Assumption(
        "u and the required torque are taken at the reference"
        + ("" if radius is None else " and within the stated error"),
        "assumed" if radius is None else "tested",
    )
    words = "covers" if holds else "does not cover"
    statement = (
        f"u = {available:.4g} N m {words} the {needed:.4g} N m that the model lacks at t = {motion.t[k]:.3g} s: "
        "u >= ‖M0 w*‖ (44), (45)"
    )
    return Verdict(
        *ROBUST_TORQUE,
        holds,
        1.0 - needed / available if available > 0 else None,
        {"u": available, "needed": needed, "time": float(motion.t[k]), "torque": np.max(torque, axis=0)},
        (*demand.assumptions, there),
        statement,
        [] if holds else _remedies(bound, scenario, needed - available),
    )


def bound_of(scenario: Scenario) -> AbstractBound | None:
    """Return the bound u of a scenario's law; None for a law without one."""
    law: Any = scenario.controller
    bound = getattr(law.step if isinstance(law, SampledData) else law, "bound", None)
    return bound if isinstance(bound, AbstractBound) else None


def _remedies(bound: Any, scenario: Scenario, lacks: float) -> list[Remedy]:
    if isinstance(bound, StateBound):
        return []
    share = float(1.0 - bound.gamma) if hasattr(bound, "gamma") else 1.0
    for name in ("margin", "size"):
        if hasattr(bound, name):
            value = float(f"{float(getattr(bound, name)) + REMEDY_FACTOR * share * lacks:.3g}")
            return [Remedy(f"a larger robust torque: {value:g} N m", {f"scheme.bound.{name}": value})]
    return []


@eqx.filter_jit
def _sizes(bound: AbstractBound, q: Any, dq: Any, tau: Any) -> Any:
    return jax.vmap(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))(q, dq, tau)
