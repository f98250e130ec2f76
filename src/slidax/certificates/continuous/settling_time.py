"""How soon the printed law settles: its source's formulas, the exact supremum, and this start's own bound."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis import Remedy
from slidax.reaching import UncertaintyBound
from slidax.scenarios import Scenario

from ..certificate import ARM, certificate
from ..numbers import listed
from ..verdict import Assumption, Verdict
from .law import PowerSurface, PrintedLaw, masses_of
from .premises import continuous_premises
from .travel_time import PIECES, bounded_time, two_power_time

Floats = NDArray[np.floating[Any]]

NAME, TITLE = "settling_time", "settled by a time"


@certificate(NAME, TITLE, covers=ARM)
def settling_time(scenario: Scenario) -> Verdict:
    """Until when the transformed error is in its core, `|ε1| <= δ`: (48)-(50) beside what is sharp.

    - `printed`: `T_max = T_r + T_s` of (48)-(50), with T_s of each joint.
    - `supremum`: the same worst case with the integral in place of its two terms, over all starts.
    - `given_start`: for the scenario's own start, with the envelope's own β along the way.
    - `deadline`: T of (20), from when on the envelope is ±ρ∞; it is kept or not whatever the three others say.

    The derivation is in docs/certificates/settling-time.md.

    - `scenario`: what is asked about.
    """
    printed = PrintedLaw.of(scenario)
    if printed is None:
        return _other_law(scenario)
    bound, powers, gain = printed.law.bound, printed.powers, printed.gain
    if powers is None or gain is None or not isinstance(bound, UncertaintyBound):
        text = "(48)-(50) are about a surface with two powers and a u of (45); this scheme has others"
        return Verdict(NAME, TITLE, None, None, {}, (), text)
    times = _Times(printed, powers, bound)
    deadline = times.deadline
    found: dict[str, Any] = {
        "printed": times.printed,
        "supremum": times.supremum,
        "given_start": times.given_start,
        "deadline": deadline,
        "reaching": times.reaching,
    }
    assumptions = (*continuous_premises(printed), *_premises(times))
    holds = all(one.status != "fails" for one in assumptions)
    words = (
        f"by (48)-(50) at t = {listed(times.printed)} s; by the same inequalities without splitting their integrals at "
        f"{listed(times.supremum)} s, from any start; from the scenario's own at {listed(times.given_start)} s"
    )
    statement = f"Each joint has |ε1| <= δ {words}" + (
        "." if deadline is None else f"; the envelope itself is ±ρ∞ from t = {listed(deadline)} s on (20)."
    )
    if not holds:
        statement = f"Values of the formulas only, since a hypothesis of theirs is not met. {statement}"
    margin = float(1.0 - np.max(times.given_start / times.printed)) if holds else None
    return Verdict(NAME, TITLE, holds, margin, found, assumptions, statement, _remedies(assumptions))


@dataclass(frozen=True)
class _Times:
    """The bounds of one law, s."""

    printed_law: PrintedLaw
    powers: PowerSurface
    bound: UncertaintyBound

    @property
    def excess(self) -> float:
        """K."""
        return float(self.bound.margin)

    @cached_property
    def spread(self) -> float:
        """How much M0 differs between postures."""
        return self.printed_law.nominal_is_constant()

    @cached_property
    def mass(self) -> Floats:
        """M0 where it is constant, else `2/(m1+m2) I` as (62) has it."""
        n = self.printed_law.joints
        if self.spread > 1e-12:
            return self.stated * np.eye(n)
        return masses_of(self.printed_law.law.nominal, np.zeros((1, n)))[0]

    @property
    def stated(self) -> float:
        """`2/(m1+m2)`."""
        return 2.0 / float(self.bound.inverse_inertia_min + self.bound.inverse_inertia_max)

    @property
    def damping(self) -> tuple[float, float]:
        """`n^((1-r)/2) λmin(K0)` and r: by how much the power of s brakes it."""
        found = self.printed_law.gain
        assert found is not None
        gain, r = found
        least = float(np.linalg.eigvalsh(0.5 * (gain + gain.T)).min())
        return self.printed_law.joints ** ((1.0 - r) / 2.0) * least, r

    @property
    def radius(self) -> Floats:
        """ρ0, [n]; 2 without an envelope, where β = 1."""
        performance, n = self.printed_law.performance, self.printed_law.joints
        return np.broadcast_to(2.0 if performance is None else np.asarray(performance.initial), n)

    @property
    def deadline(self) -> Floats | None:
        """T, [n]; None for an envelope without one."""
        found = getattr(self.printed_law.performance, "deadline", None)
        return None if found is None else np.broadcast_to(np.asarray(found), self.printed_law.joints)

    @cached_property
    def reaching(self) -> dict[str, float]:
        """Until s = 0: as printed, the supremum, and from this start."""
        (c, r), both = self.damping, 2.0 / self.stated
        printed = 2.0 / (self.excess * np.sqrt(both)) + 2.0 / (c * both ** ((r + 1.0) / 2.0) * (r - 1.0))
        heaviest = float(np.linalg.eigvalsh(self.mass).max())
        start = np.sqrt(self.energy / heaviest)
        return {
            "printed": float(printed),
            "supremum": heaviest * two_power_time(self.excess, 0.0, c, r),
            "given_start": heaviest * two_power_time(self.excess, 0.0, c, r, upper=float(start)),
        }

    @cached_property
    def printed(self) -> Floats:
        """`T_r + T_s`, (48)-(50), [n]."""
        one = self.powers
        near = 2.0 ** (-(one.p + 1.0) / 2.0) * self.radius / (one.k1 * (1.0 - one.p))
        far = 2.0 ** (-(one.q + 1.0) / 2.0) * self.radius / (one.k2 * (one.q - 1.0))
        return self.reaching["printed"] + near + far

    @cached_property
    def supremum(self) -> Floats:
        """The same without splitting the integrals, until `|ε1| = δ`, [n]."""
        one = self.powers
        each = zip(one.k1, one.p, one.k2, one.q, one.delta, strict=True)
        sliding = np.array([two_power_time(k1, p, k2, q, lower=delta) for k1, p, k2, q, delta in each])
        return self.reaching["supremum"] + 0.5 * self.radius * sliding

    @property
    def energy(self) -> float:
        """`sᵀ M0 s` at t = 0; infinite for a start outside, where s is not defined."""
        s = self.printed_law.start[1]
        return float(s @ self.mass @ s) if np.isfinite(s).all() else np.inf

    @cached_property
    def given_start(self) -> Floats:
        """From the scenario's own start, [n]; infinite for one outside of the envelope."""
        _, s, eps = self.printed_law.start
        if not (np.isfinite(s).all() and np.isfinite(eps).all()):
            return np.full(self.printed_law.joints, np.inf)
        largest = np.sqrt(self.energy / float(np.linalg.eigvalsh(self.mass).min()))
        reach = self.printed_law.pull_inverse(largest)
        reached = self.reaching["given_start"]
        furthest = np.maximum(np.abs(eps), reach)
        return np.array([self._slid(joint, reached, furthest[joint]) for joint in range(len(s))])

    def _slid(self, joint: int, begin: float, eps: float) -> float:
        """When a joint that is on the surface since `begin`, no further out than `eps`, is in its core, s."""
        law, delta = self.printed_law, float(self.powers.delta[joint])

        def pull(x: Floats) -> Floats:
            return law.pulls(x)[:, joint]

        if law.sides is None:
            return begin + bounded_time(pull, eps, delta)

        def place(x: Floats, sign: float) -> Floats:
            return sign * law.places(np.broadcast_to(sign * x[:, None], (len(x), law.joints)))[:, joint]

        # Either sign: s may have carried the error across.
        wait = max(bounded_time(pull, eps, delta, partial(place, sign=sign)) for sign in (1.0, -1.0))
        return _when_waited(lambda t: law.radius(t)[:, joint], begin, wait)


def _when_waited(radius: Any, begin: float, wait: float) -> float:
    """No earlier than when `∫ dt/ρ` from `begin` on is `wait`; ρ falls, so that rectangles from the left are short."""
    if wait <= 0.0:
        return begin
    last = begin + wait * float(radius(np.array([begin]))[0])
    times = np.linspace(begin, last, PIECES + 1)
    grown = np.cumsum(np.diff(times) / radius(times[:-1]))
    place = int(np.searchsorted(grown, wait))
    return float(times[min(place + 1, PIECES)])


def _premises(times: _Times) -> tuple[Assumption, ...]:
    found, law = [], times.printed_law
    diagonal = law.gain_is_diagonal
    found.append(
        Assumption(
            "K0 is diagonal and positive definite, so that sᵀ K0 Sig^r(s) >= λmin Σ|s_i|^(r+1)",
            "proved" if diagonal else "fails",
        )
    )
    if times.spread <= 1e-12:
        off = np.abs(times.mass - times.stated * np.eye(law.joints)).max() / times.stated
        text = "M0 is the same in 64 random postures"
        text += ", and 2/(m1+m2) I (62)" if off < 1e-9 else "; its largest eigenvalue takes the place of 2/(m1+m2)"
        found.append(Assumption(text, "tested", times.spread))
    else:
        text = (
            f"M0 = 2/(m1+m2) I (62): M0 differs by {100 * times.spread:.3g} % of its size between 64 random postures, "
            "and its rate is no part of (64)"
        )
        found.append(Assumption(text, "fails", times.spread))
    found.append(
        Assumption(
            "what the model lacks is no more than b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖ (19), see `robust_torque`", "assumed"
        )
    )
    return tuple(found)


def _remedies(assumptions: tuple[Assumption, ...]) -> tuple[Remedy, ...]:
    failing = [one.text for one in assumptions if one.status == "fails"]
    if len(failing) == 1 and failing[0].startswith("the unit vector"):
        return (Remedy("take the unit vector (44) instead of its layer", {"scheme.reaching.layer": 0.0}),)
    return ()


def _other_law(scenario: Scenario) -> Verdict:
    law = scenario.controller
    step = getattr(law, "step", None)
    performance = getattr(getattr(step, "transformation", None), "performance", None)
    deadline = getattr(performance, "deadline", None)
    if deadline is None:
        text = "(48)-(50) are about the paper's law in continuous time, which this is not."
        return Verdict(NAME, TITLE, None, None, {}, (), text)
    each = np.broadcast_to(np.asarray(deadline), law.joints)
    text = (
        "(48)-(50) are about continuous time. At a period the envelope is the promise: "
        f"±ρ∞ from t = {listed(each)} s on (20), if it is kept (`loop_rate`)."
    )
    return Verdict(NAME, TITLE, None, None, {"deadline": each}, (), text)
