"""The envelope as a sampled-data law sees it, its plan equation, and the worst-case recursion of one joint."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from slidax.law.error_transformations import EnvelopeFrame, PrescribedPerformance, Sides, psi_and_slope
from slidax.law.implicit_steps import Barrier
from slidax.law.surfaces import AbstractSurface

from ..sampled_scenario import Floats


def pad_rows(values: Any, count: int) -> Any:
    """Return an array with its last row repeated up to `count` rows; longer arrays are unchanged."""
    rows = np.asarray(values)
    return np.concatenate([rows, np.repeat(rows[-1:], max(count - len(rows), 0), axis=0)])


def map_rows(compiled: Callable[..., Any], rows: Any, most: int, *arguments: Any) -> Any:
    """Apply a compiled function to padded rows; outputs are NumPy arrays with the row as first axis.

    - `compiled`: from `arguments` and all rows to a tree of arrays of the same length.
    - `most`: largest number of rows of all calls that share the program.
    """
    return jax.tree.map(lambda output: np.asarray(output)[: len(rows)], compiled(*arguments, pad_rows(rows, most)))


@dataclass(frozen=True)
class SampledEnvelope:
    """Radii at times a period apart, as the law computes them.

    - `times`: when torques start [N], s.
    - `radius`, `rate`, `curvature`: ρ, ρ̇ and ρ̈ [N n].
    - `now`: N, not below a tenth of ρ [N n]; `ahead`: A, likewise [N n].
    - `lower`, `upper`: b and b̄ [n].
    - `lead`, `horizon`, `period`: c, H and h [s].
    """

    times: Floats
    radius: Floats
    rate: Floats
    curvature: Floats
    now: Floats
    ahead: Floats
    lower: Floats
    upper: Floats
    lead: float
    horizon: float
    period: float

    @classmethod
    def of(
        cls, drawn: PrescribedPerformance, sides: Sides, *, period: float, horizon: float, times: Floats, most: int = 0
    ) -> SampledEnvelope:
        """The envelope at given times.

        - `sides`: of the envelope, as the start decides them.
        - `period`, `horizon`: h and H [s].
        - `times`: when torques start [N], s.
        - `most`: largest number of times of all calls that share the compiled program.
        """
        lead = horizon - 0.5 * period
        radius, rate, curvature, now, ahead = map_rows(_sampled, times, most, drawn, sides, lead, horizon)
        lower, upper = np.asarray(sides.lower), np.asarray(sides.upper)
        return cls(np.asarray(times), radius, rate, curvature, now, ahead, lower, upper, lead, horizon, period)

    @property
    def slim(self) -> NDArray[np.bool_]:
        """True where N or A is at its lower limit, so that it is not the led envelope [N n]."""
        now = self.radius + self.lead * self.rate
        ahead = now + self.horizon * (self.rate + self.lead * self.curvature)
        # The law's own sums are rounded otherwise than these.
        rounding = 1e-12 * self.radius
        return (now < self.now - rounding) | (ahead < self.ahead - rounding)

    @property
    def outgrown(self) -> Floats:
        """Excess of the tangent to N over N, `N_k + r (A_k - N_k) - N_{k+1}`, where N is not convex [N-1 n].

        Includes the loss of the step to the deadline, some `h c ρ̈`; the rule's proof needs zero.
        """
        r = self.period / self.horizon
        tangent = self.now[:-1] + r * (self.ahead[:-1] - self.now[:-1])
        return np.maximum(tangent - self.now[1:], 0.0)

    @property
    def sagging(self) -> Floats:
        """`h (ρ̇_k + ρ̇_{k+1})/2 - (ρ_{k+1} - ρ_k)`, where ρ̇ is not concave: the loss of the mean of y and e [N-1 n]."""
        mean = 0.5 * self.period * (self.rate[:-1] + self.rate[1:])
        return np.maximum(mean - np.diff(self.radius, axis=0), 0.0)

    @property
    def unruly(self) -> NDArray[np.bool_]:
        """True for joints without a proof of the closed form [n].

        There a radius is slim, or more than a millionth of the final radius is lost.
        """
        lost = np.sum(self.outgrown + self.sagging, axis=0)
        return np.any(self.slim, axis=0) | (lost > 1e-6 * self.radius[-1])


@eqx.filter_jit
def _sampled(drawn: PrescribedPerformance, sides: Sides, lead: Any, horizon: Any, times: Any) -> Any:
    """ρ, ρ̇, ρ̈, N and A at each time."""

    def at(t: Any) -> Any:
        frame = drawn.frame(t, jnp.asarray(lead), jnp.asarray(horizon), sides)
        moved = drawn.performance.radius_rate_curvature(t)
        return (*(jnp.broadcast_to(value, sides.lower.shape) for value in moved), frame.now, frame.ahead)

    return jax.vmap(at)(jnp.asarray(times))


Both = Float[Array, "2 n"]


@dataclass(frozen=True)
class WorstCaseReach:
    """Bounds of a joint's error on both sides at each sample; all [2 N n], below zero first, in size.

    - `led`: of y; `error`: of e.
    - `room`: distance to the envelope, `β ρ - e`, negative where it may be left.
    """

    led: Floats
    error: Floats
    room: Floats

    @property
    def holds(self) -> NDArray[np.bool_]:
        """True for joints of which no sample can be outside [n]."""
        return np.all(self.room > 0.0, axis=(0, 1))


def worst_case_reach(
    narrowing: SampledEnvelope,
    surface: AbstractSurface,
    missed: Floats | float,
    start: tuple[Floats, Floats],
    delay: float = 0.0,
    noise: tuple[float, float] = (0.0, 0.0),
    s_next: Floats | float = 0.0,
) -> WorstCaseReach:
    """Return the worst case of `y⁺ = (1 - r) y + r (A ψ(ε) + Q w)` and of e, over all w and s⁺ within their bounds.

    Without a delay the bound of y is attained, by the w that always acts outwards; docs/certificates/loop-rate.md.

    - `missed`: w̄, estimation error in the period from each sample [N n] or a number, rad/s² or m/s².
    - `start`: y and e at the first sample [n], rad or m.
    - `delay`: D [periods]; the law acts on a prediction, whose error is the effect of w meanwhile.
    - `noise`: bounds of the errors of the position and the velocity that the step acts on, rad or m, and rad/s or m/s.
    - `s_next`: s̄, bound of s⁺, [N n] or a number, rad/s or m/s.
    """
    shape = narrowing.radius.shape
    each = [jnp.asarray(np.broadcast_to(np.asarray(value, float), shape)) for value in (missed, s_next)]
    h, horizon, lead = narrowing.period, narrowing.horizon, narrowing.lead
    age = delay * h
    # Prediction error of y over the delay, and the whole effect of w on y in a period, over r.
    foreseen = 0.5 * age * age + lead * age
    share = horizon * horizon + horizon * age + foreseen
    inputs = (jnp.asarray(narrowing.now), jnp.asarray(narrowing.ahead), *each)
    begun = tuple(jnp.maximum(jnp.stack([-jnp.asarray(value), jnp.asarray(value)]), 0.0) for value in start)
    sides = Sides(jnp.asarray(narrowing.lower), jnp.asarray(narrowing.upper))
    measured = noise[0] + lead * noise[1]
    numbers = tuple(
        jnp.asarray(value) for value in (h, horizon, foreseen, share, measured, measured + horizon * noise[1])
    )
    led, error = (np.asarray(value) for value in _scanned(surface, sides, numbers, inputs, begun))
    led, error = np.moveaxis(led, 1, 0), np.moveaxis(error, 1, 0)
    wide = np.stack([-narrowing.lower * narrowing.radius, narrowing.upper * narrowing.radius])
    return WorstCaseReach(led, error, wide - error)


@functools.partial(jax.jit)
def _scanned(surface: Any, sides: Sides, numbers: Any, inputs: Any, begun: Any) -> Any:
    h, horizon, foreseen, share, measured, taken = numbers
    r, eta = h / horizon, h / (2.0 * horizon - h)

    def step(carry: Any, now: Any) -> Any:
        led, error, eps = carry
        radius, ahead, missed, s_next = now
        target = led + foreseen * missed + measured + horizon * s_next
        eps, psi, _ = solve_plan(surface, sides, radius, horizon, target, eps)
        later = (1.0 - r) * led + r * (ahead * psi + share * missed + taken)
        after = ((1.0 - eta) * error + eta * (led + later)) / (1.0 + eta)
        return (later, after, eps), (led, error)

    return jax.lax.scan(step, (*begun, jnp.zeros_like(begun[0])), inputs)[1]


def solve_plan(
    surface: AbstractSurface, sides: Sides, radius: Any, horizon: Any, target: Both, guess: Both
) -> tuple[Both, Both, Both]:
    """Solve `N ψ(ε) + H φ(ε) = target` below and above zero: ε in size, with `|ψ(ε)|` and `φ(|ε|)`; all [2 n].

    - `radius`: N [n].
    - `horizon`: H [s].
    - `target`: bound of y + H s⁺, below and above zero, in size [2 n].
    - `guess`: ε of the sample before, in size [2 n].
    """
    frame = EnvelopeFrame(now=radius, ahead=radius, sides=sides)
    barrier = Barrier(frame, surface, horizon)
    sign = jnp.array([[-1.0], [1.0]])
    # Rounded up by more than the equation is solved to.
    signed = sign * (target * (1.0 + 1e-12) + 2e-12 * horizon)

    def solve(target: Any, guess: Any) -> Any:
        return barrier.solve(target, guess, barrier.value_and_slope(guess))

    eps = jax.vmap(solve)(signed, sign * guess)
    psi = jax.vmap(lambda value: frame.psi_and_slope(value)[0])(eps)
    phi = jax.vmap(lambda value: surface.phi_and_slope(value)[0])(eps)
    return sign * eps, sign * psi, sign * phi


SIGN = (-1.0, 1.0)


def plan_deviation(
    surface: AbstractSurface, sides: Sides, radius: Any, horizon: Any, ideal: tuple[Any, Any], target: Any, guess: Any
) -> tuple[Any, Any, Any]:
    """Return bounds of the change of ψ(ε) and φ(ε) when the plan's equation is solved for another target; in size.

    `N ψ(ε) + H φ(ε) = x` for `|x - x_b|` within a bound; ψ and φ increase with x, so its ends suffice.

    - `radius`: N [n].
    - `horizon`: H [s].
    - `ideal`: x_b and its ε [n].
    - `target`: bounds of `x - x_b` below and above, in size [2 n j].
    - `guess`: ε of the sample before [2 n j].

    Returns these for below and above [2 n j], and ε at the two ends [2 n j].
    """
    middle, eps_middle = ideal
    frame = EnvelopeFrame(now=radius, ahead=radius, sides=sides)
    barrier = Barrier(frame, surface, horizon)
    sign = jnp.asarray(SIGN)[:, None, None]
    # Further out by more than the equation is solved to, here and for the ideal arm.
    reach = target * (1.0 + 1e-12) + 4e-12 * (horizon + jnp.abs(middle)[:, None])
    signed = middle[:, None] + sign * reach

    def solve(target: Any, guess: Any) -> Any:
        return barrier.solve(target, guess, barrier.value_and_slope(guess))

    each = jax.vmap(jax.vmap(solve, in_axes=1, out_axes=1))
    eps = each(signed, guess)
    there = jax.vmap(jax.vmap(lambda value: frame.psi_and_slope(value)[0], in_axes=1, out_axes=1))(eps)
    psi = jnp.maximum(sign * (there - frame.psi_and_slope(eps_middle)[0][:, None]), 0.0)
    phi = jnp.maximum(reach - radius[:, None] * psi, 0.0) / horizon
    return psi, phi, eps


STEPS = 12
"""Each side of the table has 2^12 places."""

NEAREST, FARTHEST = 1e-12, 1e4
"""Transformed errors at the table's ends; neighbouring ones differ by 0.9 %."""


SLOPES = (1e-100, 1e100)
"""Limits of all slopes."""


@dataclass(frozen=True)
class SlopeTable:
    """dφ/dψ over ε, with the least and the largest of 2^l places from each one on, for each joint.

    - `eps`: ascending [M].
    - `least`, `most`: [l n M].
    """

    eps: Any
    least: Any
    most: Any

    @classmethod
    def of(cls, surface: AbstractSurface, sides: Sides) -> SlopeTable:
        """The table of a law."""
        size = np.geomspace(NEAREST, FARTHEST, 2**STEPS)
        eps = jnp.asarray(np.concatenate([-size[::-1], np.zeros(1), size]))
        slope = np.asarray(_slope(surface, sides, eps)).T
        # Between two places it is off them by no more than their own difference, wherever it turns.
        ratio = np.maximum(slope[:, 1:] / slope[:, :-1], slope[:, :-1] / slope[:, 1:])
        step = np.concatenate([ratio, ratio[:, -1:]], axis=1)
        step = np.maximum(step, np.concatenate([ratio[:, :1], ratio], axis=1))
        least, most = [slope / step], [slope * step]
        for level in range(STEPS + 1):
            span = 2**level
            least.append(np.minimum(least[-1], _later(least[-1], span)))
            most.append(np.maximum(most[-1], _later(most[-1], span)))
        return cls(eps, jnp.asarray(np.array(least)), jnp.asarray(np.array(most)))

    def between(self, low: Any, high: Any) -> tuple[Any, Any]:
        """The least and the largest slope for ε between two values [n], each [n].

        - `low`, `high`: ends, `low <= high` [n].
        """
        size = self.eps.shape[0]
        i = jnp.clip(jnp.searchsorted(self.eps, low, side="right") - 1, 0, size - 1)
        j = jnp.clip(jnp.searchsorted(self.eps, high, side="left"), i, size - 1)
        level = jnp.asarray(jnp.floor(jnp.log2((j - i + 1).astype(float)) + 1e-9), i.dtype)
        joint = jnp.arange(i.shape[0])
        second = j - 2**level + 1
        least = jnp.minimum(self.least[level, joint, i], self.least[level, joint, second])
        most = jnp.maximum(self.most[level, joint, i], self.most[level, joint, second])
        return least, most


jax.tree_util.register_dataclass(SlopeTable, data_fields=["eps", "least", "most"], meta_fields=[])


@eqx.filter_jit
def _slope(surface: AbstractSurface, sides: Sides, eps: Any) -> Any:
    def at(value: Any) -> Any:
        each = jnp.broadcast_to(value, sides.lower.shape)
        pulled = surface.phi_and_slope(each)[1]
        moved = psi_and_slope(each, sides)[1]
        return jnp.clip(pulled / jnp.maximum(moved, SLOPES[0]), *SLOPES)

    return jax.vmap(at)(eps)


def _later(values: Floats, span: int) -> Floats:
    """The values so many places on; the last ones again beyond the end."""
    return np.concatenate([values[:, span:], np.repeat(values[:, -1:], span, axis=1)], axis=1)
