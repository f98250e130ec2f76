"""The paper's inequalities for its own examples."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax._types import State
from slidax.controllers import SlidingMode
from slidax.performance import FixedTime
from slidax.reaching import FixedTimeReaching, TwoPowerReaching, UncertaintyBound
from slidax.scenarios import Scenario
from slidax.simulation import Run
from slidax.surfaces import LinearCoreFixedTime, SingularityFree, SmoothFixedTime
from slidax.transformations import PrescribedPerformance


class Parts(NamedTuple):
    """The parts of CFTSMPPC, each of its own class."""

    law: SlidingMode
    transformation: PrescribedPerformance
    performance: FixedTime
    surface: SmoothFixedTime
    reaching: FixedTimeReaching
    bound: UncertaintyBound


def parts_of(scenario: Scenario) -> Parts:
    """The parts of the scenario's scheme.

    - `scenario`: one of the examples.

    Raises DefinitionError if its scheme is not CFTSMPPC with a fixed-time envelope.
    """
    law = scenario.controller
    transformation = getattr(law, "transformation", None)
    performance = getattr(transformation, "performance", None)
    surface = getattr(law, "surface", None)
    reaching = getattr(law, "reaching", None)
    bound = getattr(law, "bound", None)
    if (
        isinstance(law, SlidingMode)
        and isinstance(transformation, PrescribedPerformance)
        and isinstance(performance, FixedTime)
        and isinstance(surface, SmoothFixedTime)
        and isinstance(reaching, FixedTimeReaching)
        and isinstance(bound, UncertaintyBound)
    ):
        return Parts(law, transformation, performance, surface, reaching, bound)
    raise DefinitionError(f"`{scenario.name}` must have the scheme cftsmppc with a fixed-time envelope")


def inverse_inertia(scenario: Scenario) -> dict[str, Any]:
    """Ranges over q2 of `‖M⁻¹(q)‖`, spectral and Frobenius, and of the eigenvalues of `M⁻¹`; also `max ‖M⁻¹M0 - I‖`.

    - `scenario`: its true robot, its nominal robot, and m1, m2, γ of (46), (47).

    The inertia of both arms depends on q2 alone.
    """
    parts = parts_of(scenario)
    law, bound = parts.law, parts.bound
    robot, n = scenario.plant.robot, law.joints
    turned = jnp.zeros((721, n)).at[:, 1].set(jnp.linspace(-jnp.pi, jnp.pi, 721))
    mass, nominal = (np.asarray(jax.vmap(arm.mass)(turned)) for arm in (robot, law.nominal))
    inverse = np.linalg.inv(mass)
    values = np.linalg.eigvalsh(inverse)
    frobenius = np.linalg.norm(inverse, axis=(1, 2))
    mismatch = np.linalg.norm(inverse @ nominal - np.eye(n), ord=2, axis=(1, 2))
    return {
        "m1": float(bound.inverse_inertia_min),
        "m2": float(bound.inverse_inertia_max),
        "gamma": float(bound.gamma),
        "eigenvalues": [float(values.min()), float(values.max())],
        "spectral": [float(values[:, -1].min()), float(values[:, -1].max())],
        "frobenius": [float(frobenius.min()), float(frobenius.max())],
        "mismatch": float(mismatch.max()),
    }


def settling_bound(scenario: Scenario) -> dict[str, Any] | None:
    """`T_max = T_r + T_s`, eqs. (48)-(50), s, with T_s of the slowest joint: the value of the formulas, no more.

    - `scenario`: whose parameters are put in.

    (50) has `ρ0/2 >= 1/β` (Proposition 5); without an envelope β = 1, so that 2 stands for ρ0. SFSMC has the exponents
    and gains of its own powers in the same places. None if the scheme is none of the fixed-time ones.
    """
    law = scenario.controller
    if not isinstance(law, SlidingMode) or not isinstance(law.bound, UncertaintyBound):
        return None
    surface, reaching = law.surface, law.reaching
    if isinstance(surface, SmoothFixedTime | LinearCoreFixedTime):
        gains, powers = (surface.k1, surface.k2), (surface.p, surface.q)
    elif isinstance(surface, SingularityFree):
        gains, powers = (surface.c1, surface.c2), (surface.alpha, surface.beta)
    else:
        return None
    if isinstance(reaching, FixedTimeReaching):
        r, gain = float(reaching.exponent), np.asarray(reaching.gain)
    elif isinstance(reaching, TwoPowerReaching):
        r, gain = float(np.max(np.asarray(reaching.v1))), np.asarray(reaching.k1)
    else:
        return None
    n, both = law.joints, float(law.bound.inverse_inertia_min + law.bound.inverse_inertia_max)
    slowest = float(np.linalg.eigvalsh(gain * np.eye(n)).min())
    first = 2 / (float(law.bound.margin) * np.sqrt(both))
    second = 2 / (n ** ((1 - r) / 2) * slowest * both ** ((r + 1) / 2) * (r - 1))
    performance = getattr(law.transformation, "performance", None)
    radius = np.asarray(performance.initial) if isinstance(performance, FixedTime) else np.asarray(2.0)
    (k1, k2), (p, q) = (tuple(np.asarray(x) for x in pair) for pair in (gains, powers))
    near = 2 ** (-(p + 1) / 2) * radius / (k1 * (1 - p))
    far = 2 ** (-(q + 1) / 2) * radius / (k2 * (q - 1))
    worst = np.argmax(np.atleast_1d(near + far))
    terms = [float(np.broadcast_to(term, n)[worst]) for term in (near, far)]
    return {
        "terms": {"reaching": [float(first), float(second)], "sliding": terms},
        "reaching": float(first + second),
        "sliding": sum(terms),
        "bound": float(first + second) + sum(terms),
        "deadlines": np.broadcast_to(np.asarray(performance.deadline), n).tolist()
        if isinstance(performance, FixedTime)
        else None,
    }


def expected_error(scenario: Scenario, run: Run) -> list[float] | None:
    """Where the boundary layer of (51) balances the disturbance, if the model is exact, [n], rad or m.

    `‖s‖ ≈ s0 ‖τ_d‖/(u - ‖τ_d‖)`, and `|e| ≈ ‖s‖/(k1 l1 β)` with `l1` of (30) and `β = (1/ϑ + 1)/ρ∞`, which is (26)
    at e = 0; the largest over the second half of the run.

    - `scenario`: what was simulated.
    - `run`: its run, with a log.
    """
    law, transformation, performance, surface, reaching, _ = parts_of(scenario)
    if run.log is None or not run.outcome.ok:
        return None
    late = np.asarray(run.log.t) > 0.5 * float(run.t1)
    disturbance = eqx.filter_vmap(lambda t, q, dq: scenario.plant.disturbance(t, State(q=q, dq=dq)))
    forces = disturbance(*(jnp.asarray(x[late]) for x in (run.log.t, run.log.state.q, run.log.state.dq)))
    force, u = np.linalg.norm(forces, axis=1), np.asarray(run.log.signals["u"])[late]
    size = float((float(reaching.layer) * force / (u - force)).max())
    p, delta = np.asarray(surface.p), np.asarray(surface.delta)
    l1 = (p * p / 2 - 5 * p / 2 + 3) * delta ** (p - 1)
    beta = (1 / np.asarray(transformation.overshoot) + 1) / np.asarray(performance.final)
    errors = np.broadcast_to(size / (np.asarray(surface.k1) * l1 * beta), law.joints)
    return [float(error) for error in errors]
