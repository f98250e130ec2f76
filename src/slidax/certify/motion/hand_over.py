"""Sliding-mode laws in sampled-data form near the reference: the nonlinear part of their plan.

At each sample such a law plans how the led error y moves over the horizon H. `y = ê_p + c v̂_p` with the predicted
error ê_p, its rate v̂_p, the period h and `c = H - h/2`. While the sliding variable s⁺ is 0, the plan leads from y to
`A ψ(ε)`, where the transformed error ε solves `N ψ(ε) + H φ(ε) = y`. ψ maps ε into the envelope, and φ is the surface's
function. N and A are the radius of y's envelope now and at the end of the plan (docs/sampled-data.md). Without an
envelope `N = A = 1`.

So the law is the linear loop of a `JointLoop` plus an acceleration g, which the law's own prediction contains: the goal

    g = (A ψ(ε) - θ0 y)/H².

|g| grows with |y|. θ0 is `linear_share`, which is 0 with an envelope. The share of an error bound that is due to g is
its term `hand-over`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law.error_transformations import PrescribedPerformance, Sides, psi
from slidax.law.implicit_steps import AbstractSurfaceStep, SlidingStep
from slidax.law.reaching_laws import SaturatedReaching
from slidax.law.sampled.controller import SampledData

from .joint_loop import linear_share
from .path_cells import PathCells

Floats = NDArray[np.float64]

LEAST, LARGEST, PLACES = 1e-9, 1e4, 2**15
"""Least and largest transformed error in the tables of ψ and φ, and their length; neighbours differ by 0.1 %."""

SETTLED = 1e-9
"""Relative distance from its final width at which an envelope counts as settled."""


@dataclass(frozen=True, eq=False)
class HandOver:
    """The plan of a law with a sliding surface, while the sliding variable s⁺ is 0.

    - `step`: step of the law; `period`: h [s]; `horizon`: H [s].
    - `share`: θ0, the share of a small led error that is left at the plan's end; 0 with an envelope.
    - `psi`, `phi`: tables of ψ(ε) on the wide and on the narrow side of the envelope [2 n M], and of φ(ε) [n M]. Both
      are for M transformed errors ε >= 0, of which the first is 0.
    """

    step: AbstractSurfaceStep
    period: float
    horizon: float
    share: float
    psi: Floats = field(repr=False)
    phi: Floats = field(repr=False)

    @classmethod
    def of(cls, law: SampledData, places: int = PLACES) -> HandOver | None:
        """Return the plan of a law; None for a law without a surface.

        - `places`: M, length of the tables.

        Raises DefinitionError for a law with a boundary layer, in which s⁺ is not 0; the message has a remedy.
        """
        step = law.step
        if not isinstance(step, AbstractSurfaceStep):
            return None
        assert law.horizon is not None
        horizon, n = float(law.horizon), law.joints
        layer = getattr(step.reaching, "layer", 0.0) if isinstance(step, SlidingStep) else 0.0
        if np.any(np.asarray(layer)):
            raise DefinitionError(
                "a bound along a motion needs a reaching law without boundary layer, so that s is exactly 0; got layer "
                f"{np.max(np.asarray(layer)):g}: set the scheme's `layer` to 0"
            )
        eps = np.concatenate([[0.0], np.geomspace(LEAST, LARGEST, places - 1)])
        rows = jnp.broadcast_to(jnp.asarray(eps)[:, None], (places, n))
        phi = np.asarray(jax.vmap(lambda row: step.surface.phi_and_slope(row)[0])(rows), float).T
        if isinstance(step.transformation, PrescribedPerformance):
            overshoot = jnp.broadcast_to(step.transformation.overshoot, (n,))
            sides = Sides(-overshoot, jnp.ones(n)), Sides(-jnp.ones(n), overshoot)
            both = np.stack([np.asarray(psi(rows, each), float).T for each in sides])
        else:
            both = np.broadcast_to(eps, (2, n, places))
        return cls(step, float(law.period), horizon, linear_share(step, horizon), both, phi)

    def along(self, cells: PathCells) -> HandOverCells:
        """Return the plan in each time cell of a motion; the law starts at time 0."""
        n, count = len(self.phi), len(cells.q)
        transformation = self.step.transformation
        if not isinstance(transformation, PrescribedPerformance):
            even = np.ones((count, n))
            return HandOverCells(self, even, even, np.full((count, n), np.inf), np.zeros(n))
        now, ahead, radius = self._settled_frames(transformation, count * cells.per_cell + 1)
        # A cell ends where the next one begins; the last one stands for all times after it.
        starts = np.arange(count) * cells.per_cell
        ends = np.append(starts[1:] + 1, len(now))
        least, most, narrow = (
            np.stack([pick(values[a:b], axis=0) for a, b in zip(starts, ends, strict=True)])
            for pick, values in ((np.min, now), (np.max, ahead), (np.min, radius))
        )
        room = narrow * np.asarray(transformation.overshoot)
        return HandOverCells(self, least, most, room, np.abs(now[0] - ahead[0]) / (self.horizon * now[0]))

    def _settled_frames(self, transformation: PrescribedPerformance, count: int) -> tuple[Floats, Floats, Floats]:
        """Return N, A and ρ at each sample until the envelope is settled, at least `count` samples, each [times n]."""
        n = len(self.phi)
        times = np.asarray(self.period * np.arange(count), float)
        final = _frames(transformation, self.horizon, self.period, np.array([FAR], float), n)[2]
        while True:
            now, ahead, radius = _frames(transformation, self.horizon, self.period, times, n)
            if np.all(radius[-1] <= final * (1.0 + SETTLED)) or times[-1] > FAR:
                return now, ahead, radius
            times = np.asarray(self.period * np.arange(2 * len(times)), float)

    def frames(self, n: int) -> tuple[Floats, Floats, Floats]:
        """Return N, A and ϑ ρ, each [times n], at each sample until the envelope has its final width.

        N and A are the radii of the led error's envelope, now and at the plan's end; 1 without an envelope. ϑ ρ is the
        width of the narrow side of the error's envelope; inf without an envelope.

        - `n`: number of joints.
        """
        transformation = self.step.transformation
        if not isinstance(transformation, PrescribedPerformance):
            return np.ones((1, n)), np.ones((1, n)), np.full((1, n), np.inf)
        now, ahead, radius = self._settled_frames(transformation, 2)
        return now, ahead, radius * np.asarray(transformation.overshoot)

    @property
    def covered(self) -> float:
        """Least value of the robust torque u, at position 0, at rest and without torque [N m]; inf without u."""
        if not isinstance(self.step, SlidingStep):
            return np.inf
        nothing = jnp.zeros(self.step.robot.joints)
        return float(self.step.bound(State(q=nothing, dq=nothing), nothing))

    def needed(self, torque: Floats, sliding: Floats) -> float:
        """Return the share of the law's reaching torque that is needed to keep the sliding variable s⁺ at 0.

        It is the largest over cells and joints. For the super-twisting law it is the share of the integral gain. Below
        1, s⁺ is exactly 0.

        - `torque`: bounds of |M0 s|/H [cells n], N m or N, with the nominal inertia M0 and the plan's horizon H.
        - `sliding`: bounds of the sliding variable |s| [cells n], rad/s or m/s.
        """
        if not isinstance(self.step, SlidingStep):
            # With s⁺ = 0 the integral v is at most |s|/H.
            return float(np.max(2.0 * sliding / (self.horizon**2 * np.asarray(self.step.k2))))  # type: ignore[attr-defined]
        reaching = self.step.reaching
        with np.errstate(divide="ignore"):
            if isinstance(reaching, SaturatedReaching):
                return float(np.max(torque / (self.covered * np.asarray(reaching.weights))))
            return float(np.max(np.linalg.norm(torque, axis=1)) / np.float64(self.covered))

    def first_sliding(self, led: Floats, velocity: Floats, along: HandOverCells) -> Floats:
        """Return a bound of the sliding variable |s| at the first sample [n], rad/s or m/s.

        At this sample the law computes s from the measurement: `|s| <= |v̂| + |N - A|/(H N) |y| + φ(ε)`, where ε solves
        `ψ(ε) = |y|/N`. All other symbols are those of the module's docstring.

        - `led`: bound of the led error |y| at the first sample [n], rad or m.
        - `velocity`: bound of |v̂|, the law's estimate of ė, at the first sample [n], rad/s or m/s.
        - `along`: the plan in each cell, with N and A.
        """
        shares = led / along.now[0]
        places = np.array([np.searchsorted(row, y) for row, y in zip(self.psi.min(axis=0), shares, strict=True)])
        steep = self.phi[np.arange(len(led)), np.minimum(places, PLACES - 1)]
        steep = np.where(places >= PLACES, np.inf, steep)
        return np.asarray(velocity + along.drift * led + steep)


FAR = 1e4
"""s: time at which every envelope has its final width."""


@dataclass(frozen=True, eq=False)
class HandOverCells:
    """The plan in each time cell of a motion.

    - `plan`: the law's plan.
    - `now`, `ahead`: the least N and the largest A, as in `HandOver.frames` [cells n], rad or m; 1 without an envelope.
    - `room`: the least width ϑ ρ of the envelope's narrow side [cells n]; inf without an envelope.
    - `drift`: |N - A|/(H N) at the first sample [n], 1/s.
    """

    plan: HandOver
    now: Floats
    ahead: Floats
    room: Floats
    drift: Floats

    def goal(self, led: Floats) -> Floats:
        """Return a bound of the goal |g|, which the plan adds to the linear loop [cells n], rad/s² or m/s².

        - `led`: bound of the led error |y| [cells n].

        Between two entries of the table, the upper ε is used. Interpolation in y keeps the bound continuous.
        """
        plan, joints = self.plan, np.arange(led.shape[1])
        if plan.share:
            return np.stack([np.interp(y, *row) for y, row in zip(led.T, self.apart, strict=True)], axis=1)
        bound = np.zeros_like(led)
        for psi_side in plan.psi:

            def target(place: NDArray[np.int64], side: Floats = psi_side) -> Floats:
                return np.asarray(self.now * side[joints, place] + plan.horizon * plan.phi[joints, place])

            low, high = np.zeros(led.shape, np.int64), np.full(led.shape, PLACES - 2)
            while np.any(high - low > 1):
                middle = (low + high) // 2
                below = target(middle) <= led
                low, high = np.where(below, middle, low), np.where(below, high, middle)
            first, last = target(low), target(low + 1)
            part = np.clip((led - first) / np.maximum(last - first, 1e-300), 0.0, 1.0)
            upper = (1.0 - part) * psi_side[joints, low + 1] + part * psi_side[joints, low + 2 - (low + 2 >= PLACES)]
            bound = np.maximum(bound, self.ahead * upper)
        # ψ(ε) has the sign of y, and N ψ(ε) is no larger.
        return np.asarray(np.minimum(bound, self.ahead / self.now * led) / plan.horizon**2)

    @property
    def apart(self) -> list[tuple[Floats, Floats]]:
        """Table of the goal without an envelope: for each joint, led errors y and bounds of `|ψ(ε) - θ0 y|/H²`.

        Each bound holds up to the next y.
        """
        plan, rows = self.plan, []
        for psi_row, phi_row in zip(plan.psi[0], plan.phi, strict=True):
            y = psi_row + plan.horizon * phi_row
            apart = np.abs(psi_row - plan.share * y)
            step = np.diff(psi_row, append=2.0 * psi_row[-1]) + plan.share * np.diff(y, append=2.0 * y[-1])
            rows.append((y, np.maximum.accumulate(apart + step) / plan.horizon**2))
        return rows


def _frames(
    transformation: PrescribedPerformance, horizon: float, period: float, times: Floats, joints: int
) -> tuple[Floats, Floats, Floats]:
    """Return N, A and ρ at times at which torques start to act, each [times n]."""
    sides = Sides(-jnp.ones(joints), jnp.ones(joints))

    padding = -len(times) % BATCH
    rows = _framed(transformation, sides, horizon - 0.5 * period, horizon, np.pad(times, (0, padding), mode="edge"))
    now, ahead, radius = (np.asarray(row, float)[: len(times)] for row in rows)
    return now, ahead, radius


@eqx.filter_jit
def _framed(transformation: Any, sides: Sides, lead: Any, horizon: Any, times: Any) -> Any:
    def at(t: Any) -> Any:
        frame = transformation.frame(t, jnp.asarray(lead), jnp.asarray(horizon), sides)
        values = frame.now, frame.ahead, transformation.performance.radius(t)
        return tuple(jnp.broadcast_to(value, sides.lower.shape) for value in values)

    return jax.vmap(at)(jnp.asarray(times))


BATCH = 2048
"""The number of times is rounded up to a multiple of this, so that JAX compiles few programs."""
