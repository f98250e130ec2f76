"""The certificates `robust_torque` and `uncertainty_bound`: the robust torque u covers the model error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.errors import percent
from slidax.core.types import State
from slidax.law.calm_step import CalmStep
from slidax.law.sampled.controller import SampledData
from slidax.law.torque_bounds import AbstractBound, StateBound, UncertaintyBound
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario

from ..certificate import ARM, Assumption, Verdict, certificate
from ..sampled_scenario import Floats, envelope_width
from .arm_motion import NominalModel, StateSequence, outer_torque, rigid_body_torque
from .demand import Demand, compute_demand
from .members import Members
from .torque_budget import torque_limits

ROBUST_TORQUE = "robust_torque", "the robust torque is large enough"

REMEDY_FACTOR = 1.05
"""Factor on the missing torque in a remedy."""


@certificate(*ROBUST_TORQUE, covers=(*ARM, "sensor", "actuator"))
def robust_torque(scenario: Scenario, demand: Demand | None = None) -> Verdict:
    """Check `u >= ‖M0 w*‖` along the motion, for every member of the set: the paper's (44), (45), docs/sampled-data.md.

    u is the robust torque, M0 the law's inertia, and w* is the disturbance that the law must compensate (`Demand`). A
    law in sampled-data form limits its compensation to u. So the sliding variable reaches 0 only if u is large enough.

    - `demand`: demand of the scenario's set; computed by default.
    """
    bound = robust_bound(scenario)
    if bound is None:
        return Verdict(*ROBUST_TORQUE, None, None, {}, (), f"`{scenario.scheme}` has no robust torque")
    demand = compute_demand(scenario) if demand is None else demand
    belief, motion = NominalModel.of(scenario, Members.of(scenario, None).plant), StateSequence.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)

    def lumped(w: Floats) -> Floats:
        return np.einsum("kij,...kj->...ki", mass, w)

    torque = demand.worst(lumped)
    if demand.jumps is not None:
        torque = torque + np.einsum("kij,kj->ki", np.abs(mass), demand.jumps)
    required = np.linalg.norm(torque, axis=1)
    feedforward = np.einsum("kij,kj->ki", mass, motion.ddq) + bias
    u = np.asarray(_bound_values(bound, jnp.asarray(motion.q), jnp.asarray(motion.dq), jnp.asarray(feedforward)))
    share = required / np.where(u > 0, u, 1e-300)
    k = int(np.argmax(share))
    needed, available = float(required[k]), float(u[k])
    holds = needed <= available
    at_reference = Assumption("u and the required torque are taken at the reference", "assumed")
    words = "covers" if holds else "does not cover"
    statement = (
        f"The robust torque ({available:.4g} N m) {words} the model error ({needed:.4g} N m) at t = {motion.t[k]:.3g} "
        "s, by the paper's (44) and (45)."
    )
    return Verdict(
        *ROBUST_TORQUE,
        holds,
        1.0 - needed / available if available > 0 else None,
        {"u": available, "needed": needed, "time": float(motion.t[k]), "torque": np.max(torque, axis=0)},
        (*demand.assumptions, at_reference),
        statement,
        [] if holds else _remedies(bound, needed - available),
    )


def robust_bound(scenario: Scenario) -> AbstractBound | None:
    """Return the object that computes the robust torque u of a scenario's law; None for a law without one."""
    law: Any = scenario.controller
    decides = law.step if isinstance(law, SampledData) else law
    bound = getattr(decides.plan if isinstance(decides, CalmStep) else decides, "bound", None)
    return bound if isinstance(bound, AbstractBound) else None


def _remedies(bound: Any, missing: float) -> list[Remedy]:
    if isinstance(bound, StateBound):
        return []
    share = float(1.0 - bound.gamma) if hasattr(bound, "gamma") else 1.0
    for name in ("margin", "size"):
        if hasattr(bound, name):
            value = float(f"{float(getattr(bound, name)) + REMEDY_FACTOR * share * missing:.3g}")
            return [Remedy(f"a larger robust torque: {value:g} N m", {f"scheme.bound.{name}": value})]
    return []


@eqx.filter_jit
def _bound_values(bound: AbstractBound, q: Any, dq: Any, tau: Any) -> Any:
    return jax.vmap(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))(q, dq, tau)


UNCERTAINTY_BOUND = "uncertainty_bound", "the uncertainty bound covers the set"

MEMBERS, STATES = 32, 128
"""Number of random members, and number of random states of each member."""

HELD_OUT = 4
"""Number of members for the independent check, relative to `MEMBERS`."""

BOUND_REMEDY_FACTOR = 1.02
"""Factor on the smallest sufficient b0, b1, b2 in a remedy."""


@dataclass(frozen=True)
class UncertaintySamples:
    """Samples of the lumped uncertainty, the paper's (18), at S random states of members.

    - `position`: ‖q‖ [S]; `speed`: ‖q̇‖² [S]; `torque`: ‖τ‖ [S].
    - `lumped`: `‖(M0 M⁻¹ - I)(τ - b) - (b - b0)‖` [S], N m. M and M0 are the inertias of the true arm and of the model.
      b is the true arm's Coriolis torque, gravity and friction minus the external torque. b0 is the model's Coriolis
      torque and gravity.
    """

    position: Floats
    speed: Floats
    torque: Floats
    lumped: Floats


@certificate(*UNCERTAINTY_BOUND, covers=(*ARM, "sensor"))
def uncertainty_bound(scenario: Scenario, family: Family | None = None) -> Verdict:
    """Check that the law's b0, b1, b2 and γ bound the lumped uncertainty, `ρ <= b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖`.

    This is the paper's (19). ρ of its (18) is `lumped` of `UncertaintySamples`: the torque that the model's error
    amounts to. A linear program over random members and states gives the b0, b1, b2 with the least mean bound for the
    same γ. Independent members and states check these values.

    - `family`: a set in place of the scenario's own, such as a study's.
    """
    bound = robust_bound(scenario)
    if not isinstance(bound, UncertaintyBound | StateBound):
        return Verdict(
            *UNCERTAINTY_BOUND,
            None,
            None,
            {},
            (),
            f"`{scenario.scheme}` has no bound b0 + b1‖q‖ + b2‖q̇‖² of the uncertainty",
        )
    gamma = float(bound.gamma) if isinstance(bound, UncertaintyBound) else 0.0
    members = Members.of(scenario, family)
    samples = uncertainty_samples(members, MEMBERS, seed=7)
    least = smallest_bound(samples, gamma)
    fresh = uncertainty_samples(members, HELD_OUT * MEMBERS, seed=8)
    missed = float(np.max(fresh.lumped - gamma * fresh.torque - _state_bound(least, fresh)))
    enough = least + np.array([max(missed, 0.0), 0.0, 0.0])
    own = np.array([float(bound.b0), float(bound.b1), float(bound.b2)])
    numbers = {
        "gamma": gamma,
        "b0": float(enough[0]),
        "b1": float(enough[1]),
        "b2": float(enough[2]),
        "held_out": max(missed, 0.0),
    }
    count = len(samples.lumped)
    text = (
        f"{MEMBERS} members of the set at {STATES} states each, and {HELD_OUT} times as many that were held out: "
        "errors inside the envelope, speeds up to twice the motion's, torques within the limits"
    )
    smallest_text = (
        f"b0 = {enough[0]:.4g} N m, b1 = {enough[1]:.4g} N m/rad, b2 = {enough[2]:.4g} N m s²/rad² with "
        f"γ = {gamma:.3g} cover {(HELD_OUT + 1) * count} samples of the paper's (18)."
    )
    if isinstance(scenario.controller, SampledData):
        statement = (
            "In sampled-data form the robust torque need only cover the model error on the motion (`robust_torque`). "
            f"{smallest_text}"
        )
        return Verdict(*UNCERTAINTY_BOUND, None, None, numbers, (Assumption(text, "tested"),), statement)
    share = max(largest_share(own, gamma, samples), largest_share(own, gamma, fresh))
    holds = share <= 1.0
    finite = np.isfinite(share)
    part = f"{percent(share)} of them are needed" if finite else "they are zero where a bound is needed"
    statement = (
        f"The law's b0, b1, b2 are {'enough' if holds else 'too small'} for the paper's (19): {part}. {smallest_text}"
    )
    return Verdict(
        *UNCERTAINTY_BOUND,
        holds,
        1.0 - share if finite else None,
        numbers | ({"share": share} if finite else {}),
        (Assumption(text, "tested"),),
        statement,
        [] if holds else [_remedy(enough)],
    )


def uncertainty_samples(members: Members, count: int, seed: int) -> UncertaintySamples:
    """Return the lumped uncertainty of `count` members, at `STATES` random states each.

    Half of the members are at corners of the set, half between a corner and the middle.
    """
    scenario = members.scenario
    random = np.random.default_rng(seed)
    points = members.extremes(count)
    inner = points[count // 2 :]
    points[count // 2 :] = 0.5 + np.random.default_rng([seed, 1]).uniform(size=(len(inner), 1)) * (inner - 0.5)
    plants = members.plants(points)
    motion = StateSequence.of(scenario)
    belief = NominalModel.of(scenario, members.plant)
    n = motion.joints
    width = envelope_width(scenario, motion.t)
    reach = np.zeros(n) if width is None else width
    fastest = np.maximum(np.abs(motion.dq).max(axis=0), 1e-3)
    limit, _ = torque_limits(scenario, n)
    columns: list[list[Floats]] = []
    for plant in plants:
        k = random.integers(0, len(motion.t), STATES)
        radius = reach if width is None else width[k]
        q = motion.q[k] + random.uniform(-1.0, 1.0, (STATES, n)) * radius
        dq = random.uniform(-2.0, 2.0, (STATES, n)) * fastest
        ddq = random.uniform(-2.0, 2.0, (STATES, n)) * np.abs(motion.ddq).max(axis=0)
        states = StateSequence(motion.t[k], q, dq, ddq)
        mass, torque = (values[0] for values in rigid_body_torque([plant], states))
        tau = torque - outer_torque([plant], states)[0]
        tau = np.clip(tau, -limit, limit)
        b = torque - np.einsum("kij,kj->ki", mass, ddq) - outer_torque([plant], states)[0]
        m0, b0 = belief.mass_and_bias(states.t, q, dq)
        acceleration = np.linalg.solve(mass, (tau - b)[..., None])[..., 0]
        lumped = np.einsum("kij,kj->ki", m0, acceleration) - (tau - b) - (b - b0)
        squares = (dq * dq).sum(axis=1)
        norms = [np.linalg.norm(values, axis=1) for values in (q, tau, lumped)]
        columns.append([norms[0], squares, norms[1], norms[2]])
    return UncertaintySamples(*(np.concatenate([column[k] for column in columns]) for k in range(4)))


def smallest_bound(samples: UncertaintySamples, gamma: float) -> Floats:
    """Return b0, b1, b2 >= 0 [3] with `lumped <= b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖` for all samples.

    Among all such values they have the least mean of the right side over the samples. `lumped` is the norm of the
    torque by which the model errs, N m (`UncertaintySamples`). The units are N m, N m/rad and N m s²/rad².

    - `gamma`: γ.
    """
    from scipy.optimize import linprog

    rows = np.stack([np.ones_like(samples.position), samples.position, samples.speed], axis=1)
    solved = linprog(
        rows.mean(axis=0), A_ub=-rows, b_ub=gamma * samples.torque - samples.lumped, bounds=[(0, None)] * 3
    )
    # A solution always exists: a large b0 is enough.
    assert solved.success, solved.message
    return np.asarray(solved.x)


def largest_share(numbers: Floats, gamma: float, samples: UncertaintySamples) -> float:
    """Return the largest ratio of `lumped - γ‖τ‖` to `b0 + b1‖q‖ + b2‖q̇‖²` over the samples.

    Up to 1 the bound (19) holds at all samples. The ratio is inf if only the denominator is 0.

    - `numbers`: b0, b1, b2 [3]. `gamma`: γ.
    """
    needs = np.maximum(samples.lumped - gamma * samples.torque, 0.0)
    bound = _state_bound(numbers, samples)
    shares = np.where(needs > 0.0, np.inf, 0.0)
    with np.errstate(over="ignore"):
        np.divide(needs, bound, out=shares, where=bound > 0.0)
    return float(shares.max())


def _state_bound(numbers: Floats, samples: UncertaintySamples) -> Floats:
    return numbers[0] + numbers[1] * samples.position + numbers[2] * samples.speed


def _remedy(enough: Floats) -> Remedy:
    changes: dict[str, Any] = {
        f"scheme.bound.{name}": float(f"{BOUND_REMEDY_FACTOR * value:.3g}")
        for name, value in zip(("b0", "b1", "b2"), enough, strict=True)
    }
    return Remedy("the smallest b0, b1, b2 that cover the set", changes)
