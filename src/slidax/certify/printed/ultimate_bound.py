"""The certificates `ultimate_bound` and `printed_period`: final error with a boundary layer, longest stable period."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.types import State
from slidax.law.reaching_laws import TwoPowerReaching
from slidax.scenarios.scenario import Scenario

from ..arm.members import corner_scenarios
from ..certificate import ARM, WORLD, Assumption, Verdict, certificate, joint_values
from ..sampled_scenario import BatchedFunction, Floats, SampledReference
from .printed_law import PrintedLaw, continuous_premises, drive_delays

ULTIMATE_BOUND = "ultimate_bound", "the final error has a bound"

SAME = 1e-9
"""Relative difference up to which two inertias count as equal."""


@certificate(*ULTIMATE_BOUND, covers=ARM)
def ultimate_bound(scenario: Scenario) -> Verdict:
    """Bound the final error of a law with the boundary layer of the paper's (51), for a bounded disturbance.

    s is the sliding variable, u the robust torque and s0 the width of the layer. Let the nominal inertia be the arm's
    own M, and D the uncompensated bias, friction and disturbance. Then `V = ½ sᵀ M s` decreases where
    `u ‖s‖²/(‖s‖ + s0) > ‖s‖ ‖D‖ + ½ ‖Ṁ‖ ‖s‖²`. This holds for ‖s‖ between the two roots σ1 < σ2 of

        ½ ‖Ṁ‖ σ² + (‖D‖ + ½ ‖Ṁ‖ s0 - u) σ + ‖D‖ s0 = 0.

    Let `s̄ = √(λmax(M)/λmin(M)) σ1`. If s̄ is below σ2 and `‖s‖ <= s̄` at some time, this holds from then on. The
    transformed error ε1 has `e = ρ ψ(ε1)` with the envelope's radius ρ, and `ε̇1 = β (s - φ(ε1))` with β of (25) and the
    surface's function φ. So in the end `|e| <= ρ max(ψ(ε̄), -ψ(-ε̄))` with `φ(ε̄) = s̄`. For `Ṁ = 0`,
    `σ1 = s0 ‖D‖/(u - ‖D‖)`.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        text = "it applies only to the paper's law with the layer of (51); for sampled data see `tracking_bound`"
        return Verdict(*ULTIMATE_BOUND, None, None, {}, (), text)
    members = [_Member(printed, member, layer) for member in corner_scenarios(scenario)]
    share, mismatch = max(member.share for member in members), max(member.mismatch for member in members)
    bound: dict[str, Any] = {
        "disturbance": max(member.largest for member in members),
        "estimate": max((member.estimate for member in members), key=lambda error: float(np.max(error))),
    }
    settled = [member.settled for member in members] if share < 1.0 and mismatch <= SAME else []
    assumptions = (
        *continuous_premises(printed, unit_vector=False),
        *_premises(printed, members, share, mismatch, settled),
    )
    holds = all(line.status != "fails" for line in assumptions)
    if holds:
        worst = max(settled, key=lambda final: float(np.max(final.error)))
        bound |= {"error": worst.error, "sliding_variable": worst.size}
        statement = (
            f"In the end |e| <= {joint_values(worst.error)}, since ‖s‖ <= {worst.size:.3g} with the layer "
            f"s0 = {layer:.3g} of the paper's (51), for a disturbance of up to {bound['disturbance']:.3g} N m."
        )
    else:
        statement = "No bound of the final error exists with the paper's (51): an assumption of its derivation fails."
    remedies = () if holds or share < 1.0 else _larger_margin(scenario, bound["disturbance"])
    return Verdict(*ULTIMATE_BOUND, holds, 1.0 - share if holds else None, bound, assumptions, statement, remedies)


@dataclass(frozen=True)
class _FinalBounds:
    """Bounds at the end of a run, with the symbols of `ultimate_bound`.

    - `size`: s̄, the bound of ‖s‖.
    - `error`: bound of |e| [n].
    - `limit`: σ2, which s̄ must not exceed.
    """

    size: float
    error: Floats
    limit: float


@dataclass(frozen=True, eq=False)
class _Member:
    """An arm of the uncertainty set, with the symbols of `ultimate_bound`.

    - `scenario`: the scenario with this arm.
    - `layer`: s0.
    """

    printed: PrintedLaw
    scenario: Scenario
    layer: float

    @cached_property
    def motion(self) -> SampledReference:
        return SampledReference(self.scenario)

    @cached_property
    def mismatch(self) -> float:
        """Largest difference between M0 and M along the motion, relative to the largest entry of M."""
        mass, nominal = self.motion.truth[0], self.motion.of_arm(self.printed.law.nominal)[0]
        return float(np.max(np.abs(mass - nominal)) / np.max(np.abs(mass)))

    @cached_property
    def residual(self) -> Floats:
        """‖D‖ along the motion [times]."""
        mass0, bias0 = self.motion.of_arm(self.printed.law.nominal)
        mass, bias = self.motion.truth
        inertial = np.einsum("kij,kj->ki", mass0 - mass, self.motion.states[2])
        return np.linalg.norm(inertial + bias0 - bias + self.motion.external_torque, axis=1)

    @property
    def largest(self) -> float:
        return float(self.residual.max())

    @cached_property
    def share(self) -> float:
        """Largest `‖D‖/u` along the motion, with u for zero torque."""
        return float(np.max(self.residual / self._u(0.0)))

    def _u(self, distance: float, tau: Floats | None = None) -> Floats:
        """Return a lower bound of u along the motion [times], for states up to `distance` from the reference."""
        q, dq, _ = self.motion.states
        smaller = [
            value * np.maximum(0.0, 1.0 - distance / np.maximum(np.linalg.norm(value, axis=1), 1e-300))[:, None]
            for value in (q, dq)
        ]
        return self._bound(*smaller, np.zeros_like(q) if tau is None else tau)[0].reshape(-1)

    @cached_property
    def _bound(self) -> BatchedFunction:
        bound = self.printed.law.bound
        return BatchedFunction(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))

    @cached_property
    def _rates(self) -> tuple[Floats, float]:
        """‖Ṁ‖ along the motion [times], and a bound of its increase if each joint is faster by 1 rad/s."""
        robot = self.motion.plant.robot
        slopes = BatchedFunction(jax.jacfwd(robot.mass))(self.motion.states[0])[0]
        rate = np.einsum("kijl,kl->kij", slopes, self.motion.states[1])
        return np.linalg.norm(rate, ord=2, axis=(1, 2)), float(
            np.max(np.linalg.norm(np.moveaxis(slopes, 3, 1), ord=2, axis=(2, 3)).sum(axis=1))
        )

    @property
    def estimate(self) -> Floats:
        """Estimate of |e| [n] by `‖s‖ ≈ s0 ‖D‖/(u - ‖D‖)`, with u for the feed-forward torque; inf if ‖D‖ reaches u."""
        mass0, bias0 = self.motion.of_arm(self.printed.law.nominal)
        u = self._u(0.0, np.einsum("kij,kj->ki", mass0, self.motion.states[2]) + bias0)
        reserve = u - self.residual
        if not (reserve > 0).all():
            return self._error(np.inf)
        return self._error(float(np.max(self.layer * self.residual / reserve)))

    @cached_property
    def settled(self) -> _FinalBounds:
        """Bounds of s and of the final |e|, iterated because u and ‖Ṁ‖ depend on the distance from the reference."""
        values = np.linalg.eigvalsh(self.motion.truth[0])
        spread = float(np.sqrt(values.max() / values.min()))
        rate, growth = self._rates
        n, size = self.printed.joints, 0.0
        for _ in range(50):
            distance = np.sqrt(n) * max(2.0 * size, float(np.max(self._error(size))))
            low, high = _roots(self._u(distance), self.residual, rate + 2.0 * growth * size, self.layer)
            new = spread * low
            if not np.isfinite(new) or new <= size * (1.0 + 1e-6):
                size = max(new, size)
                break
            size = new
        else:
            size = np.inf
        if not np.isfinite(size):
            return _FinalBounds(np.inf, np.full(n, np.inf), 0.0)
        return _FinalBounds(size, self._error(size), high)

    def _error(self, size: float) -> Floats:
        """Return the bound of |e| for `‖s‖ <= size` [n]."""
        n, law = self.printed.joints, self.printed
        if not np.isfinite(size):
            return np.full(n, np.inf)
        eps = law.phi_inverse(size)
        both = np.abs(law.psi(np.stack([eps, -eps]))).max(axis=0)
        return law.radius(np.array([self.scenario.t1]))[0] * both


def _roots(u: Floats, residual: Floats, rate: Floats, layer: float) -> tuple[float, float]:
    """Return the largest σ1 and the least σ2 along the motion; inf and 0 if the roots do not exist at some time."""
    quadratic, linear, constant = 0.5 * rate, residual + 0.5 * rate * layer - u, residual * layer
    discriminant = linear * linear - 4.0 * quadratic * constant
    if np.any(linear >= 0.0) or np.any(discriminant < 0.0):
        return np.inf, 0.0
    doubled = -linear + np.sqrt(discriminant)
    return float(np.max(2.0 * constant / doubled)), float(np.min(doubled / np.maximum(2.0 * quadratic, 1e-300)))


def _premises(
    printed: PrintedLaw, members: list[_Member], share: float, mismatch: float, settled: list[_FinalBounds]
) -> tuple[Assumption, ...]:
    over = f"along the reference, at {len(members[0].motion.times)} times"
    if len(members) > 1:
        over += f", for the scenario and {len(members) - 1} corners of its uncertain set"
    same, diagonal = mismatch <= SAME, printed.gain_is_diagonal
    text = "the law's inertia is the arm's own"
    text += f", {over}" if same else f"; it differs by {100 * mismatch:.3g} %"
    assumptions = [
        Assumption("K0 is diagonal and positive definite, so that it reduces s", "proved" if diagonal else "fails"),
        Assumption(text, "tested" if same else "fails", mismatch),
    ]
    covered = share < 1.0
    text = f"the robust torque u covers the uncompensated disturbance, friction and bias, {over}"
    assumptions.append(Assumption(text, "tested" if covered else "fails", share))
    if settled:
        margin = min(final.limit - final.size for final in settled)
        enough = bool(np.isfinite(margin) and margin >= 0.0)
        text = "at every size of s from σ1 to s̄ the layer outweighs the disturbance and the arm's change of inertia"
        assumptions.append(Assumption(text, "tested" if enough else "fails", margin if np.isfinite(margin) else None))
        text = "the run reaches this bound at some time, from which on it holds"
        assumptions.append(Assumption(text, "assumed"))
    return tuple(assumptions)


def _larger_margin(scenario: Scenario, needed: float) -> tuple[Remedy, ...]:
    margin = getattr(getattr(scenario.controller, "bound", None), "margin", None)
    if margin is None:
        return ()
    value = float(margin) + float(np.ceil(needed))
    return (Remedy("a larger robust torque", {"scheme.bound.margin": value}),)


PRINTED_PERIOD = "printed_period", "stable at its period"

SAFE = 0.95
"""Share of the limit up to which a period is accepted.

Nearer to the limit a loop is stable, but an eigenvalue near -1 amplifies the torque's steps (section "Longest period"
in docs/tutorials/reproduce-the-paper.md).
"""


@certificate(*PRINTED_PERIOD, covers=ARM, reads=(*WORLD, "sensor", "transmission", "scheme", "simulation"))
def printed_period(scenario: Scenario) -> Verdict:
    """Check that the paper's law is stable near e = 0 with its torque held over a period h.

    The condition is `h < 0.95 · 2/λmax(M⁻¹ (M0 Λ + (u/s0) I))`, with the true and the nominal inertia M and M0, the
    robust torque u and the layer's width s0. Near e = 0 the law is `τ = -(M0 Λ + (u/s0) I) ė - ...` with `Λ = φ'(0) β`,
    the surface's function φ and `β = ∂ε1/∂e`. A sampled double integrator with that damping has an eigenvalue at -1
    exactly where `h M⁻¹ (M0 Λ + (u/s0) I)` has one at 2. The surface alone has the limit `2/λmax(M⁻¹ M0 Λ)`, the layer
    alone `2 s0 λmin(M)/u`.

    The verdict's `bound` has `limit`, `2/λmax(M⁻¹ (M0 Λ + (u/s0) I))`, and `period`, 95 % of it. `surface` and `layer`
    are the limits of these two parts alone, all in s.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        return Verdict(*PRINTED_PERIOD, None, None, {}, (), "it applies only to printed laws with u s/(‖s‖ + s0)")
    delays = drive_delays(scenario)
    plant = scenario.plant
    if delays or getattr(plant, "own", plant).sensor is not None:
        text = (
            "not applicable: its limit holds for exact measurements and a torque that acts at once; the scenario has "
            f"{delays or 'a `sensor`'}, with which `statistical` tests the loop"
        )
        return Verdict(*PRINTED_PERIOD, None, None, {}, (), text)
    if layer == 0.0 or isinstance(printed.law.reaching, TwoPowerReaching):
        limits = {"period": 0.0, "limit": 0.0, "surface": _limits(printed, scenario, np.inf)[1], "layer": 0.0}
    else:
        each = [_limits(printed, member, layer) for member in corner_scenarios(scenario)]
        limit, surface, layer_limit = map(min, zip(*each, strict=True))
        limits = {"period": SAFE * limit, "limit": limit, "surface": surface, "layer": layer_limit}
    limit, period = limits["period"], scenario.period
    claim = f"With the torque held for less than {1e3 * limit:.3g} ms the loop is stable and smooth near its goal"
    if limit == 0.0:
        claim = "A unit vector without a layer, or a power of s below one, chatters at every period"
    if not printed.held:
        text = f"{claim}; this scenario's torque follows the state at once, and `period` is the integrator's step."
        return Verdict(*PRINTED_PERIOD, None, None, limits, (), text)
    cases = len(corner_scenarios(scenario)) - 1
    over = f", for the scenario and {cases} corners of its uncertain set" if cases else ""
    assumptions = (
        Assumption("the loop is linear near its goal: e and s are small against ρ∞, δ and s0", "assumed"),
        Assumption(
            f"M, M0 and u are computed along the reference, at {len(SampledReference(scenario).times)} times{over}",
            "tested",
        ),
    )
    holds = period < limit
    statement = f"{claim}: h < {SAFE:g} · 2/λmax(M⁻¹ (M0 Λ + (u/s0) I)); the period is {1e3 * period:.3g} ms."
    margin = 1.0 - period / limit if limit > 0.0 else -1.0
    remedies = [Remedy("the law in its sampled-data form", {"scheme.sampled_data": {}})]
    if limit > 0.0:
        remedies.insert(0, Remedy("a shorter period", {"simulation.period": float(f"{0.95 * limit:.2g}")}))
    return Verdict(*PRINTED_PERIOD, holds, margin, limits, assumptions, statement, () if holds else remedies)


def _limits(printed: PrintedLaw, member: Scenario, layer: float) -> tuple[float, float, float]:
    """Return the limits of the period [s]: by surface and layer together, by the surface alone, and by the layer alone.

    - `member`: the scenario with one of the set's arms. `layer`: s0.
    """
    law, motion, n = printed.law, SampledReference(member), printed.joints
    mass, (mass0, bias0) = motion.truth[0], motion.of_arm(law.nominal)
    slope = np.ones(n)
    if printed.sides is not None:
        slope = 1.0 / -np.asarray(printed.sides.lower) + 1.0 / np.asarray(printed.sides.upper)
    rate = printed.slopes() * slope / printed.radius(motion.times)
    q, dq, ddq = motion.states
    feedforward = np.einsum("kij,kj->ki", mass0, ddq) + bias0
    u = BatchedFunction(lambda q, dq, tau: law.bound(State(q=q, dq=dq), tau))(q, dq, feedforward)[0].reshape(-1)
    surface = np.linalg.solve(mass, mass0 * rate[:, None, :])
    layer_part = np.linalg.inv(mass) * (u / layer)[:, None, None]
    return _period(surface + layer_part), _period(surface), _period(layer_part)


def _period(matrices: np.ndarray) -> float:
    if not np.all(np.isfinite(matrices)):
        # A product of gains or torques overflows: no period is short enough.
        return 2.0 / float(np.finfo(float).max)
    return 2.0 / max(float(np.max(np.abs(np.linalg.eigvals(matrices)))), 1e-300)
