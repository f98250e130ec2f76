"""The exact worst case of one joint's error, sample by sample, for a bounded estimation error."""

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

from ..each import Floats
from .narrowing import Narrowing

Both = Float[Array, "2 n"]


@dataclass(frozen=True)
class Reach:
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


def reached(
    narrowing: Narrowing,
    surface: AbstractSurface,
    missed: Floats | float,
    start: tuple[Floats, Floats],
    delay: float = 0.0,
    noise: tuple[float, float] = (0.0, 0.0),
    s_next: Floats | float = 0.0,
) -> Reach:
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
    return Reach(led, error, wide - error)


@functools.partial(jax.jit)
def _scanned(surface: Any, sides: Sides, numbers: Any, inputs: Any, begun: Any) -> Any:
    h, horizon, foreseen, share, measured, taken = numbers
    r, eta = h / horizon, h / (2.0 * horizon - h)

    def step(carry: Any, now: Any) -> Any:
        led, error, eps = carry
        radius, ahead, missed, s_next = now
        target = led + foreseen * missed + measured + horizon * s_next
        eps, place, _ = aimed(surface, sides, radius, horizon, target, eps)
        later = (1.0 - r) * led + r * (ahead * place + share * missed + taken)
        after = ((1.0 - eta) * error + eta * (led + later)) / (1.0 + eta)
        return (later, after, eps), (led, error)

    return jax.lax.scan(step, (*begun, jnp.zeros_like(begun[0])), inputs)[1]


def aimed(
    surface: AbstractSurface, sides: Sides, radius: Any, horizon: Any, target: Both, guess: Both
) -> tuple[Both, Both, Both]:
    """Solve `N ψ(ε) + H φ(ε) = target` below and above zero: ε in size, with `|ψ(ε)|` and `φ(|ε|)`; all [2 n].

    - `radius`: N [n].
    - `horizon`: H [s].
    - `target`: bound of y + H s⁺, below and above zero, in size [2 n].
    - `guess`: ε of the sample before, in size [2 n].
    """
    frame = Frame(now=radius, ahead=radius, sides=sides)
    barrier = Barrier(frame, surface, horizon)
    sign = jnp.array([[-1.0], [1.0]])
    # Rounded up by more than the equation is solved to.
    signed = sign * (target * (1.0 + 1e-12) + 2e-12 * horizon)

    def solve(target: Any, guess: Any) -> Any:
        return barrier.solve(target, guess, barrier.value_and_slope(guess))

    eps = jax.vmap(solve)(signed, sign * guess)
    place = jax.vmap(lambda value: frame.place_and_slope(value)[0])(eps)
    pull = jax.vmap(lambda value: surface.pull_and_slope(value)[0])(eps)
    return sign * eps, sign * place, sign * pull
