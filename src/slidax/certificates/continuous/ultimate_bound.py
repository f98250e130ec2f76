"""Where the boundary layer of (51) leaves the error, for a disturbance of known size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from slidax._types import State
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario

from ..certificate import ARM, certificate
from ..corners import members_of
from ..each import Each
from ..members import Motion
from ..numbers import listed
from ..verdict import Assumption, Verdict
from .law import PrintedLaw
from .premises import continuous_premises

Floats = NDArray[np.floating[Any]]

NAME, TITLE = "ultimate_bound", "the error stays below a bound in the end"

SAME = 1e-9
"""Two arms whose inertias differ by less than this part are the same."""


@certificate(NAME, TITLE, covers=ARM)
def ultimate_bound(scenario: Scenario) -> Verdict:
    """How large the error may still be once s is small, under (51) and a bounded disturbance.

    With a nominal inertia that is the arm's own, and D what is left of bias, friction and disturbance, `V = ½ sᵀ M s`
    falls wherever `u ‖s‖²/(‖s‖ + s0) > ‖s‖ ‖D‖ + ½ ‖Ṁ‖ ‖s‖²`, which is so between the two roots σ1 < σ2 of

        ½ ‖Ṁ‖ σ² + (‖D‖ + ½ ‖Ṁ‖ s0 - u) σ + ‖D‖ s0 = 0.

    So a run with `‖s‖ <= s̄ = √(λmax(M)/λmin(M)) σ1`, if that is below σ2, keeps it, and by
    `ε̇1 = β (s - pull(ε1))` then `|e| <= ρ max(ψ(ε̄), -ψ(-ε̄))` with `pull(ε̄) = s̄`. For `Ṁ = 0` it is
    `σ1 = s0 ‖D‖/(u - ‖D‖)`.

    - `scenario`: what is asked about.
    """
    printed = PrintedLaw.of(scenario)
    layer = None if printed is None else printed.layer
    if printed is None or layer is None:
        text = "it is about a law in printed form with the layer of (51); at a period `loop_rate` has the bound"
        return Verdict(NAME, TITLE, None, None, {}, (), text)
    members = [_Member(printed, one, layer) for one in members_of(scenario)]
    share, mismatch = max(member.share for member in members), max(member.mismatch for member in members)
    found: dict[str, Any] = {
        "disturbance": max(member.largest for member in members),
        "estimate": max((member.estimate for member in members), key=lambda one: float(np.max(one))),
    }
    settled = [member.settled for member in members] if share < 1.0 and mismatch <= SAME else []
    assumptions = (
        *continuous_premises(printed, unit_vector=False),
        *_premises(printed, members, share, mismatch, settled),
    )
    holds = all(one.status != "fails" for one in assumptions)
    if holds:
        worst = max(settled, key=lambda one: float(np.max(one.error)))
        found |= {"error": worst.error, "sliding_variable": worst.size}
        statement = (
            f"In the end |e| <= {listed(worst.error)}, since ‖s‖ <= {worst.size:.3g} (51), with a disturbance of up to "
            f"{found['disturbance']:.3g} N m against s0 = {layer:.3g}."
        )
    else:
        statement = "There is no bound of the error under (51), since an assumption of its derivation is not met."
    remedies = () if holds or share < 1.0 else _larger(scenario, found["disturbance"])
    return Verdict(NAME, TITLE, holds, 1.0 - share if holds else None, found, assumptions, statement, remedies)


@dataclass(frozen=True)
class _Settled:
    """What is left in the end.

    - `size`: s̄.
    - `error`: of |e| [n].
    - `below`: σ2, which s̄ must not exceed.
    """

    size: float
    error: Floats
    below: float


@dataclass(frozen=True, eq=False)
class _Member:
    """One arm of the set.

    - `printed`: the law.
    - `scenario`: with this arm.
    - `layer`: s0.
    """

    printed: PrintedLaw
    scenario: Scenario
    layer: float

    @cached_property
    def motion(self) -> Motion:
        """Along the reference."""
        return Motion(self.scenario)

    @cached_property
    def mismatch(self) -> float:
        """How much M0 differs from M along the motion, relative to its size."""
        mass, nominal = self.motion.truth[0], self.motion.of_arm(self.printed.law.nominal)[0]
        return float(np.max(np.abs(mass - nominal)) / np.max(np.abs(mass)))

    @cached_property
    def left(self) -> Floats:
        """‖D‖ along the motion [N]."""
        bias0 = self.motion.of_arm(self.printed.law.nominal)[1]
        mass, bias = self.motion.truth
        mass0 = self.motion.of_arm(self.printed.law.nominal)[0]
        reached = np.einsum("kij,kj->ki", mass0 - mass, self.motion.states[2])
        return np.linalg.norm(reached + bias0 - bias + self.motion.pushed, axis=1)

    @property
    def largest(self) -> float:
        """Of ‖D‖."""
        return float(self.left.max())

    @cached_property
    def share(self) -> float:
        """The largest `‖D‖/u`; of u what does not depend on the torque."""
        return float(np.max(self.left / self._u(0.0)))

    def _u(self, off: float, tau: Floats | None = None) -> Floats:
        """No more than u along the motion [N], for a state that is nearer to zero than the reference by `off`."""
        q, dq, _ = self.motion.states
        near = [one * np.maximum(0.0, 1.0 - off / np.maximum(np.linalg.norm(one, axis=1), 1e-300))[:, None]
                for one in (q, dq)]  # fmt: skip
        given = np.zeros_like(q) if tau is None else tau
        return self._size(*near, given)[0].reshape(-1)

    @cached_property
    def _size(self) -> Each:
        bound = self.printed.law.bound
        return Each(lambda q, dq, tau: bound(State(q=q, dq=dq), tau))

    @cached_property
    def _rates(self) -> tuple[Floats, float]:
        """‖Ṁ‖ along the motion [N], and by how much it grows for each rad/s that a joint is faster."""
        robot = self.motion.plant.robot
        each = Each(jax.jacfwd(robot.mass))(self.motion.states[0])[0]
        rate = np.einsum("kijl,kl->kij", each, self.motion.states[1])
        return np.linalg.norm(rate, ord=2, axis=(1, 2)), float(
            np.max(np.linalg.norm(np.moveaxis(each, 3, 1), ord=2, axis=(2, 3)).sum(axis=1))
        )

    @property
    def estimate(self) -> Floats:
        """The estimate `‖s‖ ≈ s0 ‖D‖/(u - ‖D‖)`, with all of u, and the |e| of it, [n]; infinite where D exceeds u."""
        mass0, bias0 = self.motion.of_arm(self.printed.law.nominal)
        u = self._u(0.0, np.einsum("kij,kj->ki", mass0, self.motion.states[2]) + bias0)
        room = u - self.left
        size = float(np.max(self.layer * self.left / np.where(room > 0, room, 1.0))) if (room > 0).all() else np.inf
        return self._error(size)

    @cached_property
    def settled(self) -> _Settled:
        """s̄ and |e| in the end; the state's own distance from the reference is found by repetition."""
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
        """|e| that goes with `‖s‖ <= size`, [n]."""
        n, law = self.printed.joints, self.printed
        if not np.isfinite(size):
            return np.full(n, np.inf)
        eps = law.pull_inverse(size)
        both = np.abs(law.places(np.stack([eps, -eps]))).max(axis=0)
        return law.radius(np.array([self.scenario.t1]))[0] * both


def _roots(u: Floats, left: Floats, rate: Floats, layer: float) -> tuple[float, float]:
    """The largest σ1 and the least σ2 along the motion; both infinite or zero where there is none."""
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
    found = [
        Assumption("K0 is diagonal and positive definite, so that it brakes", "proved" if diagonal else "fails"),
        Assumption(text, "tested" if same else "fails", mismatch),
    ]
    covered = share < 1.0
    text = f"u covers what is left of disturbance, friction and bias, {over}"
    found.append(Assumption(text, "tested" if covered else "fails", share))
    if settled:
        room = min(one.below - one.size for one in settled)
        enough = bool(np.isfinite(room) and room >= 0.0)
        text = "at every size of s from σ1 to s̄ the layer outweighs the disturbance and the arm's change of inertia"
        found.append(Assumption(text, "tested" if enough else "fails", room if np.isfinite(room) else None))
        found.append(
            Assumption("the run once comes as near to its reference as the bound; then it stays so", "assumed")
        )
    return tuple(found)


def _larger(scenario: Scenario, needed: float) -> tuple[Remedy, ...]:
    margin = getattr(getattr(scenario.controller, "bound", None), "margin", None)
    if margin is None:
        return ()
    value = float(margin) + float(np.ceil(needed))
    return (Remedy("a larger robust torque", {"scheme.bound.margin": value}),)
