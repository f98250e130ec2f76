"""The certificate `uncertainty_bound`: the smallest parameters of the uncertainty bound (19), by a linear program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.controllers import SampledData
from slidax.diagnosis import Remedy
from slidax.reaching import StateBound, UncertaintyBound
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family

from ..certificate import ARM, certificate
from ..each import Floats
from ..verdict import Assumption, Verdict
from .members import Members
from .motion import Belief, Motion, needed, outer
from .robust_torque import bound_of
from .torque_budget import limits_of
from .width import width_along

UNCERTAINTY_BOUND = "uncertainty_bound", "b0, b1, b2 cover the set"

MEMBERS, STATES = 32, 128
"""Number of random arms, and of random states for each."""

HELD_OUT = 4
"""Factor of the number of arms for an independent check."""

BOUND_REMEDY_FACTOR = 1.02
"""Factor of the smallest parameters in a remedy."""


@dataclass(frozen=True)
class Samples:
    """Samples of the lumped uncertainty (18).

    - `position`: ‖q‖ [S]; `speed`: ‖q̇‖² [S]; `torque`: ‖τ‖ [S].
    - `lumped`: `‖(M0 M⁻¹ - I)(τ - b) - (b - b0)‖` [S], N m.
    """

    position: Floats
    speed: Floats
    torque: Floats
    lumped: Floats


@certificate(*UNCERTAINTY_BOUND, covers=(*ARM, "sensor"))
def uncertainty_bound(scenario: Scenario, family: Family | None = None) -> Verdict:
    """Check that the law's b0, b1, b2 and γ bound the lumped uncertainty, `ρ <= b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖` (19).

    ρ of (18) is `‖(M0 M⁻¹ - I)(τ - b) - (b - b0)‖`, with b the true arm's weight, velocity forces and friction minus
    the external torque. A linear program gives the b0, b1, b2 with the least mean bound for the same γ, over random
    members and states; independent ones check them.

    - `family`: another set than the scenario's own, such as a study's.
    """
    bound = bound_of(scenario)
    if not isinstance(bound, UncertaintyBound | StateBound):
        return Verdict(*UNCERTAINTY_BOUND, None, None, {}, (), f"`{scenario.scheme}` has no bound with b0, b1, b2")
    gamma = float(bound.gamma) if isinstance(bound, UncertaintyBound) else 0.0
    members = Members.of(scenario, family)
    samples = samples_of(members, MEMBERS, seed=7)
    least = smallest(samples, gamma)
    fresh = samples_of(members, HELD_OUT * MEMBERS, seed=8)
    missed = float(np.max(fresh.lumped - gamma * fresh.torque - _known(least, fresh)))
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
        f"γ = {gamma:.3g} cover {(HELD_OUT + 1) * count} samples of (18)"
    )
    if isinstance(scenario.controller, SampledData):
        statement = (
            "in sampled-data form u need only cover the torque that the model lacks on the motion (`robust_torque`); "
            f"{smallest_text}"
        )
        return Verdict(*UNCERTAINTY_BOUND, None, None, numbers, (Assumption(text, "tested"),), statement)
    share = max(used(own, gamma, samples), used(own, gamma, fresh))
    holds = share <= 1.0
    finite = np.isfinite(share)
    part = f"{share:.0%} of them are needed" if finite else "they are zero where a bound is needed"
    statement = f"the law's b0, b1, b2 are {'enough' if holds else 'too small'} (19), {part}; {smallest_text}"
    return Verdict(
        *UNCERTAINTY_BOUND,
        holds,
        1.0 - share if finite else None,
        numbers | ({"share": share} if finite else {}),
        (Assumption(text, "tested"),),
        statement,
        [] if holds else [_remedy(enough)],
    )


def samples_of(members: Members, count: int, seed: int) -> Samples:
    """Return samples of a set: half of the members at its ends, half anywhere between there and its middle.

    - `count`: number of members.
    """
    scenario = members.scenario
    random = np.random.default_rng(seed)
    points = members.extremes(count)
    inner = points[count // 2 :]
    points[count // 2 :] = 0.5 + np.random.default_rng([seed, 1]).uniform(size=(len(inner), 1)) * (inner - 0.5)
    plants = members.plants(points)
    motion = Motion.of(scenario)
    belief = Belief.of(scenario, members.plant)
    n = motion.joints
    width = width_along(scenario, motion.t)
    reach = np.zeros(n) if width is None else width
    fastest = np.maximum(np.abs(motion.dq).max(axis=0), 1e-3)
    limit, _ = limits_of(scenario, n)
    columns: list[list[Floats]] = []
    for plant in plants:
        k = random.integers(0, len(motion.t), STATES)
        radius = reach if width is None else width[k]
        q = motion.q[k] + random.uniform(-1.0, 1.0, (STATES, n)) * radius
        dq = random.uniform(-2.0, 2.0, (STATES, n)) * fastest
        ddq = random.uniform(-2.0, 2.0, (STATES, n)) * np.abs(motion.ddq).max(axis=0)
        states = Motion(motion.t[k], q, dq, ddq)
        mass, torque = (values[0] for values in needed([plant], states))
        tau = torque - outer([plant], states)[0]
        tau = np.clip(tau, -limit, limit)
        b = torque - np.einsum("kij,kj->ki", mass, ddq) - outer([plant], states)[0]
        m0, b0 = belief.mass_and_bias(states.t, q, dq)
        acceleration = np.linalg.solve(mass, (tau - b)[..., None])[..., 0]
        lumped = np.einsum("kij,kj->ki", m0, acceleration) - (tau - b) - (b - b0)
        squares = (dq * dq).sum(axis=1)
        norms = [np.linalg.norm(values, axis=1) for values in (q, tau, lumped)]
        columns.append([norms[0], squares, norms[1], norms[2]])
    return Samples(*(np.concatenate([column[k] for column in columns]) for k in range(4)))


def smallest(samples: Samples, gamma: float) -> Floats:
    """Return b0, b1, b2 >= 0 that cover all samples, with the least mean of `b0 + b1‖q‖ + b2‖q̇‖²`."""
    from scipy.optimize import linprog

    rows = np.stack([np.ones_like(samples.position), samples.position, samples.speed], axis=1)
    solved = linprog(
        rows.mean(axis=0), A_ub=-rows, b_ub=gamma * samples.torque - samples.lumped, bounds=[(0, None)] * 3
    )
    # A solution always exists: b0 alone can cover everything.
    assert solved.success, solved.message
    return np.asarray(solved.x)


def used(numbers: Floats, gamma: float, samples: Samples) -> float:
    """Return the largest share of `b0 + b1‖q‖ + b2‖q̇‖²` that samples need; inf where it is 0 and they need more.

    - `numbers`: b0, b1, b2.
    """
    needs = np.maximum(samples.lumped - gamma * samples.torque, 0.0)
    bound = _known(numbers, samples)
    shares = np.where(needs > 0.0, np.inf, 0.0)
    with np.errstate(over="ignore"):
        np.divide(needs, bound, out=shares, where=bound > 0.0)
    return float(shares.max())


def _known(numbers: Floats, samples: Samples) -> Floats:
    return numbers[0] + numbers[1] * samples.position + numbers[2] * samples.speed


def _remedy(enough: Floats) -> Remedy:
    changes: dict[str, Any] = {
        f"scheme.bound.{name}": float(f"{BOUND_REMEDY_FACTOR * value:.3g}")
        for name, value in zip(("b0", "b1", "b2"), enough, strict=True)
    }
    return Remedy("the smallest b0, b1, b2 that cover the set", changes)
