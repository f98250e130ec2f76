"""Whether the robust torque is large enough for what the model lacks."""

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
from ..verdict import Assumption, Verdict
from .demand import demand as demand_of
from .evaluated import Floats
from .members import Members
from .motion import Belief, Motion

NAME, TITLE = "robust_torque", "u is enough"

SPARE = 1.05
"""Beyond what is needed, in a remedy."""


@certificate(NAME, TITLE, covers=(*ARM, "sensor", "actuator"))
def robust_torque(
    scenario: Scenario, demand: Demand | None = None, *, radius: Any = None, speed: Any = None
) -> Verdict:
    """Is `u >= ‖M0 w*‖` along the motion, for every member of the set? (44), (45), docs/sampled-data.md.

    A law in sampled-data form makes up for no more than u covers, and `s⁺ = 0` is kept just if it covers all.

    - `scenario`: with a law that has a bound u.
    - `demand`: what its set asks for; found if not given.
    - `radius`, `speed`: bounds of the error and of its rate, [n] or [N n], if known: what is asked for beside the
      reference is then counted.
    """
    bound = bound_of(scenario)
    if bound is None:
        said = f"`{scenario.scheme}` has no robust torque"
        return Verdict(NAME, TITLE, None, None, {}, (), said)
    demand = demand_of(scenario) if demand is None else demand
    belief, motion = Belief.of(scenario, Members.of(scenario, None).plant), Motion.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)

    def lumped(w: Floats) -> Floats:
        return np.einsum("kij,...kj->...ki", mass, w)

    torque = demand.worst(lumped)
    if demand.jumping is not None:
        torque = torque + np.einsum("kij,kj->ki", np.abs(mass), demand.jumping)
    if radius is not None and demand.beside is not None:
        torque = torque + np.einsum("kij,kj->ki", np.abs(mass), demand.beside(radius, speed))
    lacks = np.linalg.norm(torque, axis=1)
    feedforward = np.einsum("kij,kj->ki", mass, motion.ddq) + bias
    u = np.asarray(_sizes(bound, jnp.asarray(motion.q), jnp.asarray(motion.dq), jnp.asarray(feedforward)))
    share = lacks / np.where(u > 0, u, 1e-300)
    k = int(np.argmax(share))
    needed, given = float(lacks[k]), float(u[k])
    holds = needed <= given
    there = Assumption(
        "u and what it covers are taken at the reference" + ("" if radius is None else " and within the stated error"),
        "assumed" if radius is None else "tested",
    )
    words = "covers" if holds else "does not cover"
    statement = (
        f"u = {given:.4g} N m {words} the {needed:.4g} N m that the model lacks at most, at t = {motion.t[k]:.3g} s: "
        "u >= ‖M0 w*‖ (44), (45)"
    )
    return Verdict(
        NAME,
        TITLE,
        holds,
        1.0 - needed / given if given > 0 else None,
        {"u": given, "needed": needed, "time": float(motion.t[k]), "torque": np.max(torque, axis=0)},
        (*demand.assumptions, there),
        statement,
        [] if holds else _remedies(bound, scenario, needed - given),
    )


def bound_of(scenario: Scenario) -> AbstractBound | None:
    """The bound u of a scenario's law; None for a law without one.

    - `scenario`: whose law.
    """
    law: Any = scenario.controller
    found = getattr(law.step if isinstance(law, SampledData) else law, "bound", None)
    return found if isinstance(found, AbstractBound) else None


def _remedies(bound: Any, scenario: Scenario, lacks: float) -> list[Remedy]:
    if isinstance(bound, StateBound):
        return []
    share = float(1.0 - bound.gamma) if hasattr(bound, "gamma") else 1.0
    for name in ("margin", "size"):
        if hasattr(bound, name):
            value = float(f"{float(getattr(bound, name)) + SPARE * share * lacks:.3g}")
            return [Remedy(f"let u cover it: {value:g} N m", {f"scheme.bound.{name}": value})]
    return []


@eqx.filter_jit
def _sizes(bound: AbstractBound, q: Any, dq: Any, tau: Any) -> Any:
    return jax.vmap(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))(q, dq, tau)
