"""The loop-rate rule along time: the exact worst case of a joint's error, sample by sample, for what is missed."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from slidax.controllers.steps.plan import Barrier
from slidax.surfaces import AbstractSurface
from slidax.transformations import Frame, Sides

from .narrowing import Narrowing

Floats = NDArray[np.floating[Any]]
Both = Float[Array, "2 n"]


@dataclass(frozen=True)
class Reach:
    """How far a joint's error may come, on both sides, at each sample; all [2 N n], below zero first, in size.

    - `led`: of y; `error`: of e.
    - `room`: what the envelope leaves, `β ρ - e`, negative where it may be left.
    """

    led: Floats
    error: Floats
    room: Floats

    @property
    def holds(self) -> NDArray[np.bool_]:
        """For which joints no sample can be outside [n]."""
        return np.all(self.room > 0.0, axis=(0, 1))


def reached(
    narrowing: Narrowing,
    surface: AbstractSurface,
    missed: Floats | float,
    start: tuple[Floats, Floats],
    delay: float = 0.0,
    noise: tuple[float, float] = (0.0, 0.0),
    s_next: Floats | float = 0.0,
) -> Reach:
    """The worst case of `y⁺ = (1 - r) y + r (A ψ(ε) + Q w)` and of e, over all w and s⁺ within their bounds.

    Without a delay the bound of y is attained, by the w that always pushes outwards; docs/certificates/loop-rate.md.

    - `narrowing`: N, A and ρ at each sample.
    - `surface`: of the law.
    - `missed`: w̄, what the estimate misses in the period from each sample [N n] or a number, rad/s² or m/s².
    - `start`: y and e at the first sample [n], rad or m.
    - `delay`: D [periods]; the law acts on a prediction that misses y and v by what w does meanwhile.
    - `noise`: bounds of what is wrong in the position and the velocity that the step acts on, rad or m and a second's.
    - `s_next`: s̄, bound of s⁺, [N n] or a number, rad/s or m/s.
    """
    shape = narrowing.radius.shape
    each = [jnp.asarray(np.broadcast_to(np.asarray(one, float), shape)) for one in (missed, s_next)]
    h, horizon, lead = narrowing.period, narrowing.horizon, narrowing.lead
    age = delay * h
    # What a prediction over the delay misses of y, and all that w does to y in a period, over r.
    foreseen = 0.5 * age * age + lead * age
    share = horizon * horizon + horizon * age + foreseen
    inputs = (jnp.asarray(narrowing.now), jnp.asarray(narrowing.ahead), *each)
    begun = tuple(jnp.maximum(jnp.stack([-jnp.asarray(one), jnp.asarray(one)]), 0.0) for one in start)
    sides = Sides(jnp.asarray(narrowing.lower), jnp.asarray(narrowing.upper))
    seen = noise[0] + lead * noise[1]
    numbers = tuple(jnp.asarray(one) for one in (h, horizon, foreseen, share, seen, seen + horizon * noise[1]))
    led, error = (np.asarray(one) for one in _scanned(surface, sides, numbers, inputs, begun))
    led, error = np.moveaxis(led, 1, 0), np.moveaxis(error, 1, 0)
    wide = np.stack([-narrowing.lower * narrowing.radius, narrowing.upper * narrowing.radius])
    return Reach(led, error, wide - error)


@functools.partial(jax.jit)
def _scanned(surface: Any, sides: Sides, numbers: Any, inputs: Any, begun: Any) -> Any:
    h, horizon, foreseen, share, seen, taken = numbers
    r, eta = h / horizon, h / (2.0 * horizon - h)

    def step(carry: Any, now: Any) -> Any:
        led, error, eps = carry
        radius, ahead, missed, s_next = now
        target = led + foreseen * missed + seen + horizon * s_next
        eps, place, _ = aimed(surface, sides, radius, horizon, target, eps)
        later = (1.0 - r) * led + r * (ahead * place + share * missed + taken)
        after = ((1.0 - eta) * error + eta * (led + later)) / (1.0 + eta)
        return (later, after, eps), (led, error)

    return jax.lax.scan(step, (*begun, jnp.zeros_like(begun[0])), inputs)[1]


def aimed(
    surface: AbstractSurface, sides: Sides, radius: Any, horizon: Any, target: Both, guess: Both
) -> tuple[Both, Both, Both]:
    """The ε of `N ψ(ε) + H pull(ε) = target` below and above zero, in size, with `|ψ(ε)|` and `pull(|ε|)`; all [2 n].

    - `surface`, `sides`: of the law.
    - `radius`: N [n].
    - `horizon`: H [s].
    - `target`: y + H s⁺ at most, below and above zero, in size [2 n].
    - `guess`: ε of before, in size [2 n].
    """
    frame = Frame(now=radius, ahead=radius, sides=sides)
    barrier = Barrier(frame, surface, horizon)
    sign = jnp.array([[-1.0], [1.0]])
    # Rounded up by more than the equation is solved to.
    signed = sign * (target * (1.0 + 1e-12) + 2e-12 * horizon)

    def solve(target: Any, guess: Any) -> Any:
        return barrier.solve(target, guess, barrier.value_and_slope(guess))

    eps = jax.vmap(solve)(signed, sign * guess)
    place = jax.vmap(lambda one: frame.place_and_slope(one)[0])(eps)
    pull = jax.vmap(lambda one: surface.pull_and_slope(one)[0])(eps)
    return sign * eps, sign * place, sign * pull
