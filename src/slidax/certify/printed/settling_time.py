"""The certificate `settling_time`: the paper's formulas, their exact supremum, and a bound for the scenario's start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.law.torque_bounds import UncertaintyBound
from slidax.scenarios.scenario import Scenario

from ..certificate import ARM, Assumption, Verdict, certificate, joint_values
from ..sampled_scenario import Floats
from .printed_law import PowerSurface, PrintedLaw, continuous_premises, masses_at

PIECES = 4000
"""Number of rectangles that bound an integral; for integrands over a few decades the error is below 1 %."""


def two_power_time(a: float, p: float, b: float, q: float, upper: float = math.inf, lower: float = 0.0) -> float:
    """Return the time in which `ẋ = -(a x^p + b x^q)` moves x from `upper` to `lower`, for `p < 1 < q` [s].

    It is `∫ dx/(a x^p + b x^q)`. With `m = (1-p)/(q-p)` and `y = (b/a) x^(q-p)` the integral from 0 to X is

        Γ(m) Γ(1-m) / (a (q-p)) · (a/b)^m · I_{y/(1+y)}(m, 1-m),

    with I the regularised incomplete beta function. I is 1 for X = ∞: the supremum over all starts (R. Aldana-López,
    D. Gómez-Gutiérrez, E. Jiménez-Rodríguez, J. D. Sánchez-Torres, M. Defoort, International Journal of Robust and
    Nonlinear Control 29, 2019). Either gain may be 0; the time may then be infinite.

    - `a`, `p`: gain and exponent near zero, p in [0, 1).
    - `b`, `q`: gain and exponent far from zero, q > 1.
    """
    if upper <= lower:
        return 0.0
    if b == 0.0:
        return math.inf if math.isinf(upper) else (upper ** (1 - p) - lower ** (1 - p)) / (a * (1 - p))
    if a == 0.0:
        return math.inf if lower == 0.0 else (lower ** (1 - q) - _power(upper, 1 - q)) / (b * (q - 1))
    from scipy.special import betainc

    m = (1.0 - p) / (q - p)
    total = math.pi / math.sin(math.pi * m) / (a * (q - p)) * (a / b) ** m
    y_low = b / a * lower ** (q - p)
    if math.isinf(upper):
        # By I_x(m, 1-m) = 1 - I_{1-x}(1-m, m), which avoids the difference of nearly equal numbers.
        return float(total * betainc(1.0 - m, m, 1.0 / (1.0 + y_low)))
    y = b / a * upper ** (q - p)
    if y_low > 1.0:
        return float(total * (betainc(1.0 - m, m, 1.0 / (1.0 + y_low)) - betainc(1.0 - m, m, 1.0 / (1.0 + y))))
    return float(total * (betainc(m, 1.0 - m, y / (1.0 + y)) - betainc(m, 1.0 - m, y_low / (1.0 + y_low))))


def passage_time_bound(phi: Callable[[Floats], Floats], upper: float, lower: float, weight: Any = None) -> float:
    """Return an upper bound of `∫ w(x) dx/f(x)` from `lower` to `upper`, for an increasing f.

    For `w = 1` this is the time in which `ẋ = -f(x)` moves x from `upper` to `lower`. The range is divided into pieces
    from x₀ to x₁ with the same x₁/x₀. On a piece f is at least f(x₀), so that it adds at most `(W(x₁) - W(x₀))/f(x₀)`,
    with W the integral of `w >= 0`.

    - `phi`: f, increasing and > 0 on the range.
    - `upper`, `lower`: 0 < lower <= upper < ∞.
    - `weight`: W, increasing; None for `W(x) = x`.
    """
    if upper <= lower:
        return 0.0
    x = np.geomspace(lower, upper, PIECES + 1)
    increments = np.diff(x if weight is None else weight(x))
    return float(np.sum(increments / phi(x[:-1])))


def _power(x: float, exponent: float) -> float:
    return 0.0 if math.isinf(x) else x**exponent


SETTLING_TIME = "settling_time", "settles by a bounded time"


@certificate(*SETTLING_TIME, covers=ARM)
def settling_time(scenario: Scenario) -> Verdict:
    """Bound the time until the transformed error is in its core, `|ε1| <= δ`: the paper's (48)-(50) and smaller bounds.

    The verdict's `bound` has these times for each joint, s:

    - `printed`: `T_max = T_r + T_s` of (48)-(50), with the reaching time T_r and the sliding time T_s of each joint.
    - `supremum`: the supremum over all starts. It is smaller, since the integrals are computed and not split in two.
    - `given_start`: the bound for the scenario's own start, with the envelope as it narrows.
    - `deadline`: T of (20), the time from which the envelope's radius is ρ∞; it does not depend on the other values.
    - `reaching`: the part of the first three times in which the sliding variable reaches 0, under the same three names;
      one value for all joints.

    docs/certificates/reference.md has the derivation.
    """
    printed = PrintedLaw.of(scenario)
    if printed is None:
        return _other_law(scenario)
    bound, powers, gain = printed.law.bound, printed.powers, printed.gain
    if powers is None or gain is None or not isinstance(bound, UncertaintyBound):
        text = "the paper's (48)-(50) require a surface with two powers and the u of (45); this scheme has others"
        return Verdict(*SETTLING_TIME, None, None, {}, (), text)
    times = _Times(printed, powers, bound)
    deadline = times.deadline
    bounds: dict[str, Any] = {
        "printed": times.printed,
        "supremum": times.supremum,
        "given_start": times.given_start,
        "deadline": deadline,
        "reaching": times.reaching,
    }
    assumptions = (*continuous_premises(printed), *_premises(times))
    holds = all(line.status != "fails" for line in assumptions)
    words = (
        f"by the paper's (48)-(50) at t = {joint_values(times.printed)} s; by the same inequalities without splitting "
        f"their integrals at {joint_values(times.supremum)} s, from any start; "
        f"from the scenario's start at {joint_values(times.given_start)} s"
    )
    statement = f"Each joint has |ε1| <= δ {words}" + (
        "." if deadline is None else f"; the envelope itself is ±ρ∞ from t = {joint_values(deadline)} s on (20)."
    )
    if not holds:
        statement = f"These values are not proved, since an assumption of the formulas fails. {statement}"
    margin = float(1.0 - np.max(times.given_start / times.printed)) if holds else None
    return Verdict(*SETTLING_TIME, holds, margin, bounds, assumptions, statement, _remedies(assumptions))


@dataclass(frozen=True)
class _Times:
    """Bounds of one law's settling time, s."""

    printed_law: PrintedLaw
    powers: PowerSurface
    bound: UncertaintyBound

    @property
    def excess(self) -> float:
        """The margin k of (45), by which the robust torque u exceeds the bound of the uncertainty, N m."""
        return float(self.bound.margin)

    @cached_property
    def spread(self) -> float:
        """Relative difference of the nominal inertia matrix M0 between postures."""
        return self.printed_law.nominal_variation()

    @cached_property
    def mass(self) -> Floats:
        """M0 if it is constant, else `2/(m1+m2) I` as in (62)."""
        n = self.printed_law.joints
        if self.spread > 1e-12:
            return self.stated * np.eye(n)
        return masses_at(self.printed_law.law.nominal, np.zeros((1, n)))[0]

    @property
    def stated(self) -> float:
        """`2/(m1+m2)`, the nominal inertia that follows from the law's bounds `m1 <= ‖M⁻¹‖ <= m2` (47)."""
        return 2.0 / float(self.bound.inverse_inertia_min + self.bound.inverse_inertia_max)

    @property
    def damping(self) -> tuple[float, float]:
        """`n^((1-r)/2) λmin(K0)` and r: gain and exponent of the power of ‖s‖ in (64), for n joints."""
        assert self.printed_law.gain is not None
        gain, r = self.printed_law.gain
        least = float(np.linalg.eigvalsh(0.5 * (gain + gain.T)).min())
        return self.printed_law.joints ** ((1.0 - r) / 2.0) * least, r

    @property
    def radius(self) -> Floats:
        """ρ0, [n]; 2 without an envelope, so that β = 1."""
        performance, n = self.printed_law.performance, self.printed_law.joints
        return np.broadcast_to(2.0 if performance is None else np.asarray(performance.initial), n)

    @property
    def deadline(self) -> Floats | None:
        """T, [n]; None for an envelope without one."""
        deadline = getattr(self.printed_law.performance, "deadline", None)
        return None if deadline is None else np.broadcast_to(np.asarray(deadline), self.printed_law.joints)

    @cached_property
    def reaching(self) -> dict[str, float]:
        """Time until s = 0: as printed, the supremum over all starts, and from the scenario's start."""
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
        k1, p, k2, q = self.powers.k1, self.powers.p, self.powers.k2, self.powers.q
        near = 2.0 ** (-(p + 1.0) / 2.0) * self.radius / (k1 * (1.0 - p))
        far = 2.0 ** (-(q + 1.0) / 2.0) * self.radius / (k2 * (q - 1.0))
        return self.reaching["printed"] + near + far

    @cached_property
    def supremum(self) -> Floats:
        """Supremum of the time until `|ε1| = δ`, without splitting the integrals, [n]."""
        powers = self.powers
        each = zip(powers.k1, powers.p, powers.k2, powers.q, powers.delta, strict=True)
        sliding = np.array([two_power_time(k1, p, k2, q, lower=delta) for k1, p, k2, q, delta in each])
        return self.reaching["supremum"] + 0.5 * self.radius * sliding

    @property
    def energy(self) -> float:
        """`sᵀ M0 s` at t = 0; infinite for a start outside the envelope, where s is not defined."""
        s = self.printed_law.start[1]
        return float(s @ self.mass @ s) if np.isfinite(s).all() else np.inf

    @cached_property
    def given_start(self) -> Floats:
        """Time from the scenario's own start, [n]; infinite for a start outside the envelope."""
        _, s, eps = self.printed_law.start
        if not (np.isfinite(s).all() and np.isfinite(eps).all()):
            return np.full(self.printed_law.joints, np.inf)
        largest = np.sqrt(self.energy / float(np.linalg.eigvalsh(self.mass).min()))
        reach = self.printed_law.phi_inverse(largest)
        reached = self.reaching["given_start"]
        furthest = np.maximum(np.abs(eps), reach)
        return np.array([self._core_time(joint, reached, furthest[joint]) for joint in range(len(s))])

    def _core_time(self, joint: int, begin: float, eps: float) -> float:
        """Return a bound of the time at which a joint reaches its core [s].

        From the time `begin` on, s = 0 and |ε1| <= `eps`.
        """
        law, delta = self.printed_law, float(self.powers.delta[joint])

        def phi(x: Floats) -> Floats:
            return law.phi(x)[:, joint]

        if law.sides is None:
            return begin + passage_time_bound(phi, eps, delta)

        def psi(x: Floats, sign: float) -> Floats:
            return sign * law.psi(np.broadcast_to(sign * x[:, None], (len(x), law.joints)))[:, joint]

        # Both signs, since the error may change its sign before s = 0.
        scaled = max(passage_time_bound(phi, eps, delta, partial(psi, sign=sign)) for sign in (1.0, -1.0))
        return _end_time(lambda t: law.radius(t)[:, joint], begin, scaled)


def _end_time(radius: Any, begin: float, scaled: float) -> float:
    """Return an upper bound of the time at which `∫ dt/ρ` from `begin` reaches `scaled` [s].

    Left rectangles underestimate the integral, since ρ decreases.
    """
    if scaled <= 0.0:
        return begin
    last = begin + scaled * float(radius(np.array([begin]))[0])
    times = np.linspace(begin, last, PIECES + 1)
    integral = np.cumsum(np.diff(times) / radius(times[:-1]))
    k = int(np.searchsorted(integral, scaled))
    return float(times[min(k + 1, PIECES)])


def _premises(times: _Times) -> tuple[Assumption, ...]:
    law = times.printed_law
    assumptions = [
        Assumption(
            "K0 is diagonal and positive definite, so that sᵀ K0 Sig^r(s) >= λmin Σ|s_i|^(r+1)",
            "proved" if law.gain_is_diagonal else "fails",
        )
    ]
    if times.spread <= 1e-12:
        difference = np.abs(times.mass - times.stated * np.eye(law.joints)).max() / times.stated
        text = "M0 is the same in 64 random postures"
        text += (
            ", and 2/(m1+m2) I (62)" if difference < 1e-9 else "; its largest eigenvalue takes the place of 2/(m1+m2)"
        )
        assumptions.append(Assumption(text, "tested", times.spread))
    else:
        text = (
            f"M0 = 2/(m1+m2) I (62): M0 differs by {100 * times.spread:.3g} % of its size between 64 random postures, "
            "and (64) omits its rate"
        )
        assumptions.append(Assumption(text, "fails", times.spread))
    text = "the lumped uncertainty is at most b0 + b1‖q‖ + b2‖q̇‖² + γ‖τ‖ (19), see `uncertainty_bound`"
    return (*assumptions, Assumption(text, "assumed"))


def _remedies(assumptions: tuple[Assumption, ...]) -> tuple[Remedy, ...]:
    failing = [line.text for line in assumptions if line.status == "fails"]
    if len(failing) == 1 and failing[0].startswith("the unit vector"):
        return (Remedy("the unit vector (44) instead of its layer", {"scheme.reaching.layer": 0.0}),)
    return ()


def _other_law(scenario: Scenario) -> Verdict:
    law = scenario.controller
    step = getattr(law, "step", None)
    performance = getattr(getattr(step, "transformation", None), "performance", None)
    deadline = getattr(performance, "deadline", None)
    if deadline is None:
        text = "The paper's bounds (48)-(50) apply only to its law in continuous time."
        return Verdict(*SETTLING_TIME, None, None, {}, (), text)
    each = np.broadcast_to(np.asarray(deadline), law.joints)
    text = (
        "The paper's bounds (48)-(50) apply only in continuous time. For a sampled-data law the guarantee is the "
        f"envelope: ±ρ∞ from t = {joint_values(each)} s on (20), if `tracking_bound` holds."
    )
    return Verdict(*SETTLING_TIME, None, None, {"deadline": each}, (), text)
