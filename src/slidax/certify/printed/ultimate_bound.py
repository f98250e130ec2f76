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
from .printed_law import PrintedLaw, continuous_premises

ULTIMATE_BOUND = "ultimate_bound", "the final error has a bound"

SAME = 1e-9
"""Relative difference below which two inertias are the same."""


@certificate(*ULTIMATE_BOUND, covers=ARM)
def ultimate_bound(scenario: Scenario) -> Verdict:
    """Bound the error once s is small, under (51) and a bounded disturbance.

    If the nominal inertia is the arm's own, and D the rest of bias, friction and disturbance, `V = ½ sᵀ M s` falls
    where `u ‖s‖²/(‖s‖ + s0) > ‖s‖ ‖D‖ + ½ ‖Ṁ‖ ‖s‖²`, that is, between the two roots σ1 < σ2 of

        ½ ‖Ṁ‖ σ² + (‖D‖ + ½ ‖Ṁ‖ s0 - u) σ + ‖D‖ s0 = 0.

    So a run with `‖s‖ <= s̄ = √(λmax(M)/λmin(M)) σ1`, if that is below σ2, keeps this bound. By `ε̇1 = β (s - φ(ε1))`
    then `|e| <= ρ max(ψ(ε̄), -ψ(-ε̄))` with `φ(ε̄) = s̄`. For `Ṁ = 0`, `σ1 = s0 ‖D‖/(u - ‖D‖)`.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        text = "it applies only to a law in printed form with the layer of (51); for sampled data see `loop_rate`"
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
            f"In the end |e| <= {joint_values(worst.error)}, since ‖s‖ <= {worst.size:.3g} (51), with a disturbance of "
            f"up to {bound['disturbance']:.3g} N m against s0 = {layer:.3g}."
        )
    else:
        statement = "No bound of the error exists under (51), because an assumption of its derivation fails."
    remedies = () if holds or share < 1.0 else _larger(scenario, bound["disturbance"])
    return Verdict(*ULTIMATE_BOUND, holds, 1.0 - share if holds else None, bound, assumptions, statement, remedies)


@dataclass(frozen=True)
class _Settled:
    """The final bounds.

    - `size`: s̄.
    - `error`: bound of |e| [n].
    - `below`: σ2, which s̄ must not exceed.
    """

    size: float
    error: Floats
    below: float


@dataclass(frozen=True, eq=False)
class _Member:
    """One arm of the set.

    - `scenario`: with this arm.
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
        """Difference of M0 from M along the motion, relative to its size."""
        mass, nominal = self.motion.truth[0], self.motion.of_arm(self.printed.law.nominal)[0]
        return float(np.max(np.abs(mass - nominal)) / np.max(np.abs(mass)))

    @cached_property
    def left(self) -> Floats:
        """‖D‖ along the motion [N]."""
        bias0 = self.motion.of_arm(self.printed.law.nominal)[1]
        mass, bias = self.motion.truth
        mass0 = self.motion.of_arm(self.printed.law.nominal)[0]
        reached = np.einsum("kij,kj->ki", mass0 - mass, self.motion.states[2])
        return np.linalg.norm(reached + bias0 - bias + self.motion.external_torque, axis=1)

    @property
    def largest(self) -> float:
        return float(self.left.max())

    @cached_property
    def share(self) -> float:
        """The largest `‖D‖/u`, with the part of u that does not depend on the torque."""
        return float(np.max(self.left / self._u(0.0)))

    def _u(self, off: float, tau: Floats | None = None) -> Floats:
        """Lower bound of u along the motion [N], for a state nearer to zero than the reference by `off`."""
        q, dq, _ = self.motion.states
        near = [
            value * np.maximum(0.0, 1.0 - off / np.maximum(np.linalg.norm(value, axis=1), 1e-300))[:, None]
            for value in (q, dq)
        ]
        return self._size(*near, np.zeros_like(q) if tau is None else tau)[0].reshape(-1)

    @cached_property
    def _size(self) -> BatchedFunction:
        bound = self.printed.law.bound
        return BatchedFunction(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))

    @cached_property
    def _rates(self) -> tuple[Floats, float]:
        """‖Ṁ‖ along the motion [N], and its growth for each rad/s of a joint's speed."""
        robot = self.motion.plant.robot
        each = BatchedFunction(jax.jacfwd(robot.mass))(self.motion.states[0])[0]
        rate = np.einsum("kijl,kl->kij", each, self.motion.states[1])
        return np.linalg.norm(rate, ord=2, axis=(1, 2)), float(
            np.max(np.linalg.norm(np.moveaxis(each, 3, 1), ord=2, axis=(2, 3)).sum(axis=1))
        )

    @property
    def estimate(self) -> Floats:
        """|e| [n] for the estimate `‖s‖ ≈ s0 ‖D‖/(u - ‖D‖)`, with all of u; infinite where D exceeds u."""
        mass0, bias0 = self.motion.of_arm(self.printed.law.nominal)
        u = self._u(0.0, np.einsum("kij,kj->ki", mass0, self.motion.states[2]) + bias0)
        room = u - self.left
        size = float(np.max(self.layer * self.left / np.where(room > 0, room, 1.0))) if (room > 0).all() else np.inf
        return self._error(size)

    @cached_property
    def settled(self) -> _Settled:
        """s̄ and the final |e|, by iteration over the state's own distance from the reference."""
        values = np.linalg.eigvalsh(self.motion.truth[0])
        spread = float(np.sqrt(values.max() / values.min()))
        rate, more = self._rates
        n, size = self.printed.joints, 0.0
        for _ in range(50):
            off = np.sqrt(n) * max(2.0 * size, float(np.max(self._error(size))))
            low, high = _roots(self._u(off), self.left, rate + 2.0 * more * size, self.layer)
            new = spread * low
            if not np.isfinite(new) or new <= size * (1.0 + 1e-6):
                size = max(new, size)
                break
            size = new
        else:
            size = np.inf
        if not np.isfinite(size):
            return _Settled(np.inf, np.full(n, np.inf), 0.0)
        return _Settled(size, self._error(size), high)

    def _error(self, size: float) -> Floats:
        """Bound of |e| for `‖s‖ <= size`, [n]."""
        n, law = self.printed.joints, self.printed
        if not np.isfinite(size):
            return np.full(n, np.inf)
        eps = law.phi_inverse(size)
        both = np.abs(law.psi(np.stack([eps, -eps]))).max(axis=0)
        return law.radius(np.array([self.scenario.t1]))[0] * both


def _roots(u: Floats, left: Floats, rate: Floats, layer: float) -> tuple[float, float]:
    """The largest σ1 and the least σ2 along the motion; infinite and zero where there is none."""
    half, linear, rest = 0.5 * rate, left + 0.5 * rate * layer - u, left * layer
    square = linear * linear - 4.0 * half * rest
    if np.any(linear >= 0.0) or np.any(square < 0.0):
        return np.inf, 0.0
    root = -linear + np.sqrt(square)
    return float(np.max(2.0 * rest / root)), float(np.min(root / np.maximum(2.0 * half, 1e-300)))


def _premises(
    printed: PrintedLaw, members: list[_Member], share: float, mismatch: float, settled: list[_Settled]
) -> tuple[Assumption, ...]:
    over = f"along the reference, at {len(members[0].motion.times)} times"
    if len(members) > 1:
        over += f", for the scenario and {len(members) - 1} corners of its uncertain set"
    same, diagonal = mismatch <= SAME, printed.gain_is_diagonal
    text = "the law's inertia is the arm's own"
    text += f", {over}" if same else f"; it differs by {100 * mismatch:.3g} %"
    assumptions = [
        Assumption("K0 is diagonal and positive definite, so that it brakes", "proved" if diagonal else "fails"),
        Assumption(text, "tested" if same else "fails", mismatch),
    ]
    covered = share < 1.0
    text = f"u covers the uncompensated disturbance, friction and bias, {over}"
    assumptions.append(Assumption(text, "tested" if covered else "fails", share))
    if settled:
        room = min(final.below - final.size for final in settled)
        enough = bool(np.isfinite(room) and room >= 0.0)
        text = "at every size of s from σ1 to s̄ the layer outweighs the disturbance and the arm's change of inertia"
        assumptions.append(Assumption(text, "tested" if enough else "fails", room if np.isfinite(room) else None))
        text = "the run once comes within the bound of its reference, and then stays there"
        assumptions.append(Assumption(text, "assumed"))
    return tuple(assumptions)


def _larger(scenario: Scenario, needed: float) -> tuple[Remedy, ...]:
    margin = getattr(getattr(scenario.controller, "bound", None), "margin", None)
    if margin is None:
        return ()
    value = float(margin) + float(np.ceil(needed))
    return (Remedy("a larger robust torque", {"scheme.bound.margin": value}),)


PRINTED_PERIOD = "printed_period", "stable at its period"

SAFE = 0.95
"""Share of the limit. Between this share and the limit a loop is stable, but its eigenvalue near -1 makes torque steps
grow, in runs of the paper's examples 20-fold within 2 % (docs/certificates/paper.md).
"""


@certificate(*PRINTED_PERIOD, covers=ARM, reads=(*WORLD, "scheme", "simulation"))
def printed_period(scenario: Scenario) -> Verdict:
    """Check `h < 2/λmax(M⁻¹ (M0 Λ + (u/s0) I))`: the printed law near its goal, held over a period.

    Near e = 0 the law is `τ = -(M0 Λ + (u/s0) I) ė - ...` with Λ = slope(0) β. A sampled double integrator with that
    damping has an eigenvalue at -1 exactly where `h M⁻¹ (M0 Λ + (u/s0) I)` has one at 2. The surface alone has the
    limit `2/λmax(M⁻¹ M0 Λ)`, the layer alone `2 s0 λmin(M)/u`.

    Bounds: `period`, with some distance from the limit; `limit`, `surface`, `layer` as above, s.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        return Verdict(*PRINTED_PERIOD, None, None, {}, (), "it applies only to a law in printed form")
    if layer == 0.0 or isinstance(printed.law.reaching, TwoPowerReaching):
        limits = {"period": 0.0, "limit": 0.0, "surface": _limits(printed, scenario, np.inf)[1], "layer": 0.0}
    else:
        each = [_limits(printed, member, layer) for member in corner_scenarios(scenario)]
        limit, surface, edge = map(min, zip(*each, strict=True))
        limits = {"period": SAFE * limit, "limit": limit, "surface": surface, "layer": edge}
    limit, period = limits["period"], scenario.period
    claim = f"With the torque held for less than {1e3 * limit:.3g} ms the loop is stable and smooth near its goal"
    if limit == 0.0:
        claim = "A unit vector without a layer chatters at every period"
    if not printed.held:
        text = f"{claim}; this scenario's torque follows the state at once, its period is the integrator's step."
        return Verdict(*PRINTED_PERIOD, None, None, limits, (), text)
    cases = len(corner_scenarios(scenario)) - 1
    over = f", for the scenario and {cases} corners of its uncertain set" if cases else ""
    assumptions = (
        Assumption("the loop is linear near its goal: e and s are small against ρ∞, δ and s0", "assumed"),
        Assumption(
            f"M, M0 and u along the reference, at {len(SampledReference(scenario).times)} times{over}", "tested"
        ),
    )
    holds = period < limit
    statement = f"{claim}: h < {SAFE:g} · 2/λmax(M⁻¹ (M0 Λ + (u/s0) I)); its period is {1e3 * period:.3g} ms."
    margin = 1.0 - period / limit if limit > 0.0 else -1.0
    remedies = [Remedy("the law in its sampled-data form", {"scheme.sampled_data": {}})]
    if limit > 0.0:
        remedies.insert(0, Remedy("a shorter period", {"simulation.period": float(f"{0.95 * limit:.2g}")}))
    return Verdict(*PRINTED_PERIOD, holds, margin, limits, assumptions, statement, () if holds else remedies)


def _limits(printed: PrintedLaw, member: Scenario, layer: float) -> tuple[float, float, float]:
    """The limits of surface and layer together, of the surface and of the layer, s."""
    law, motion, n = printed.law, SampledReference(member), printed.joints
    mass, (mass0, bias0) = motion.truth[0], motion.of_arm(law.nominal)
    steep = np.ones(n)
    if printed.sides is not None:
        steep = 1.0 / -np.asarray(printed.sides.lower) + 1.0 / np.asarray(printed.sides.upper)
    rate = printed.slopes() * steep / printed.radius(motion.times)
    q, dq, ddq = motion.states
    feedforward = np.einsum("kij,kj->ki", mass0, ddq) + bias0
    u = BatchedFunction(lambda q, dq, tau: law.bound(State(q=q, dq=dq), tau))(q, dq, feedforward)[0].reshape(-1)
    surface = np.linalg.solve(mass, mass0 * rate[:, None, :])
    edge = np.linalg.inv(mass) * (u / layer)[:, None, None]
    return _period(surface + edge), _period(surface), _period(edge)


def _period(matrices: np.ndarray) -> float:
    if not np.all(np.isfinite(matrices)):
        # The products of gains or torques overflow: no period is short enough.
        return 2.0 / float(np.finfo(float).max)
    return 2.0 / max(float(np.max(np.abs(np.linalg.eigvals(matrices)))), 1e-300)
