"""Bounds of the joints' errors along time, each sample's from those before: the loop of a law with all that is unknown.

docs/certificates/loop-rate.md has the inequalities, with the same letters, and their proof.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .kernels import ACCELERATION, ERROR, ESTIMATE, LED, MISSED, SHIFT, SLIP
from .pulls import aimed_at_most

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Course:
    """What does not depend on time; units of periods, but for s and the inertia.

    - `table`: of the plan's equation.
    - `period`: h [s]; `horizon`: H [periods]; `part`: of the delay that is not whole [periods].
    - `of_push`, `of_place`, `of_change`: sizes of responses, the newest last [7 n j L] each.
    - `tails`: what is older does at most, of pushes, places and changes, times the largest of it, faded.
    - `fading`: a period's share of that [n j].
    - `spread`: `|κ(t)/κ - 1|` at most, for each κ [n j]; `kappa`: these κ [n j].
    - `coupling`: of the joints' accelerations [n n].
    - `layer`: s̄, what the boundary layer leaves of s [rad/s or m/s].
    """

    table: Any
    period: Any
    horizon: Any
    part: Any
    of_push: Any
    of_place: Any
    of_change: Any
    tails: Any
    fading: Any
    spread: Any
    kappa: Any
    coupling: Any
    layer: Any


jax.tree_util.register_dataclass(Course, data_fields=list(Course.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class Passing:
    """What comes at each sample, first axis.

    - `now`, `ahead`: N and A [N n].
    - `free`, `held`: responses to what is known, with noise, below and above zero in size [N 2 7 n j]: without p, and
      with the first p held. Of the acceleration both are the size.
    - `stray`: w* that is not known [N n], `bend`: by what the known one bends e off its mean [N n j], rad or m.
    - `heavy`: the largest eigenvalue of M0 [N].
    """

    now: Any
    ahead: Any
    free: Any
    held: Any
    stray: Any
    bend: Any
    heavy: Any


jax.tree_util.register_dataclass(Passing, data_fields=list(Passing.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class Bounds:
    """Bounds at each sample, the worst of all κ.

    - `error`: of e where torques set in, below and above zero, in size [N 2 n].
    - `missed`: of ω [N n], `acceleration`: of ë [N n], in rad/period² or m/period²; `led`: of ŷ [N n].
    - `estimate`: of ŵ [N n], in the same unit as ω; `needed`: what u must cover, ‖M0 s/H‖ [N], N m.
    """

    error: Floats
    missed: Floats
    acceleration: Floats
    led: Floats
    estimate: Floats
    needed: Floats


def propagated(course: Course, passing: Passing, start: Floats, first: tuple[Floats, Floats]) -> Bounds:
    """The bounds of all samples.

    - `course`, `passing`: the loop.
    - `start`: e at the first sample [n].
    - `first`: bounds of the spread of p there around what is held, and of p - ŷ [n].
    """
    found = _scanned(course, passing, jnp.asarray(start), tuple(jnp.asarray(one) for one in first))
    return Bounds(*(np.asarray(one) for one in found))


@functools.partial(jax.jit)
def _scanned(course: Course, passing: Passing, start: Any, first: Any) -> Any:
    _, n, j, length = course.of_push.shape
    h, horizon = course.period, course.horizon
    r, lead = 1.0 / horizon, horizon - 0.5
    eta = 0.5 / lead
    side = jnp.broadcast_to(jnp.stack([jnp.maximum(-start, 0.0), jnp.maximum(start, 0.0)])[:, :, None], (2, n, j))
    # Each sample is written twice, a length apart, so that those before it always lie side by side.
    history = jnp.zeros((n, j, 2 * length))
    spread_first, back_first = first

    def past(kernel: Any, tail: Any, history: Any, most: Any, k: Any) -> Any:
        """Of all samples before this; what is of it must be zero until it is known."""
        window = jax.lax.dynamic_slice_in_dim(history, k % length + 1, length, axis=2)
        return jnp.sum(kernel[..., :-1] * window[..., :-1], axis=-1) + tail * most

    def with_newest(history: Any, value: Any, k: Any) -> Any:
        place = k % length
        history = jax.lax.dynamic_update_index_in_dim(history, value, place, axis=2)
        return jax.lax.dynamic_update_index_in_dim(history, value, place + length, axis=2)

    def step(carry: Any, now: Any) -> Any:
        k, push, place, change, most, led_next, last, sigma = carry
        coupled_last = last["coupled"]
        radius, ahead, free, held, stray, bend, heavy = now
        tail_push, tail_place, tail_change = course.tails
        # 1. What is before this decision: ŷ, y - ŷ, e.
        by_push = past(course.of_push, tail_push, push, most[0], k)
        by_place = past(course.of_place, tail_place, place, most[1], k)
        by_change = past(course.of_change, tail_change, change, most[2], k)
        own = course.part * (0.5 * course.part + lead) * coupled_last

        def either(output: int) -> Any:
            """From p itself, and from its changes: the less [2 n j]."""
            by_itself, by_turns = free[:, output] + by_place[output], held[:, output] + by_change[output]
            return jnp.minimum(by_itself, by_turns) + by_push[output]

        shift = jnp.max(either(SHIFT), axis=0) + own
        linear = free[:, LED] + by_push[LED] + by_place[LED]
        led = jnp.maximum(jnp.where(k > 0, jnp.minimum(led_next, linear), linear), 0.0)
        linear = free[:, ERROR] + by_push[ERROR] + by_place[ERROR] + 0.5 * course.part**2 * coupled_last
        around = led + shift
        mean = ((1.0 - eta) * last["error"] + eta * (last["around"] + around) + last["bent"]) / (1.0 + eta)
        error = jnp.where(k > 0, jnp.maximum(jnp.minimum(mean, linear), 0.0), side)
        # 2. s⁺: zero, or what the boundary layer leaves where u covers twice what is missed.
        s_next = jnp.broadcast_to(course.layer, (n,))
        # 3. The place p that the plan aims at, and its change.
        target = led + (horizon * h * s_next)[:, None]
        share, pull = aimed_at_most(course.table, radius, horizon * h, target)
        aim = ahead[:, None] * share
        most_aim, least_aim = jnp.max(aim, axis=0), jnp.max(aim + last["aim"][::-1], axis=0)
        quicker = 2.0 * horizon * h * s_next[:, None]
        moved = r * (last["back"] + last["missed"])
        was = jnp.max(last["share"], axis=0)
        steepest = jnp.maximum(ahead / radius, 1.0)[:, None]
        nearer = jnp.abs(radius - last["radius"])[:, None] * was
        bent = jnp.abs((ahead - radius) - (last["ahead"] - last["radius"]))[:, None] * was
        drawn = jnp.abs(ahead - last["ahead"])[:, None] * was
        turned = jnp.maximum(drawn, steepest * (moved + quicker) + bent + (steepest - 1.0) * nearer)
        change_now = jnp.where(k > 0, jnp.minimum(turned, least_aim), spread_first[:, None])
        # 3b. p - ŷ, from what it was and from what it may be.
        still = (1.0 - r) * last["back"] + r * last["missed"] + nearer
        going = (1.0 + (steepest - 1.0) * r) * last["back"] + steepest * quicker
        going = going + (steepest - 1.0) * (r * last["missed"] + nearer)
        back = jnp.max(jnp.abs(ahead - radius)[:, None] * share + horizon * h * pull, axis=0)
        back = jnp.minimum(back + (horizon * h * s_next)[:, None], jnp.maximum(still, going) + bent)
        back = jnp.where(k > 0, back, back_first[:, None])
        change = with_newest(change, change_now, k)
        by_change = by_change + course.of_change[..., -1] * change_now
        by_place = by_place + course.of_place[..., -1] * most_aim
        place = with_newest(place, most_aim, k)
        # 4. The joint's acceleration, and with it what it does to itself and the others beyond the loop of one κ.
        strayed = course.kappa * stray[:, None]
        acceleration = jnp.max(either(ACCELERATION), axis=0) + strayed
        others = course.coupling @ jnp.max((1.0 + course.spread) * acceleration, axis=1)
        coupled = course.spread * acceleration + others[:, None] + strayed
        both = jnp.where(course.part > 0, jnp.maximum(coupled, coupled_last), coupled)
        push = with_newest(push, both, k)
        newest = (both, most_aim, change_now)
        most = tuple(jnp.maximum(course.fading * old, new) for old, new in zip(most, newest, strict=True))
        by_push = by_push + course.of_push[..., -1] * both
        # 5. The next ŷ and s.
        missed = either(MISSED)
        led_after = (1.0 - r) * led + r * jnp.maximum(aim + missed, 0.0)
        slip = jnp.max(either(SLIP), axis=0)
        # With s⁺ = 0 what is kept of s is a mean of what the velocity missed of its plans.
        sigma = (1.0 - r) * sigma + heavy * jnp.linalg.norm(jnp.max(slip, axis=1)) / (h * h)
        estimate = jnp.max(either(ESTIMATE), axis=0)
        size = jnp.max(missed, axis=0)
        last = {"aim": aim, "share": share, "back": back, "missed": size, "bent": bend + 0.25 * coupled}
        last |= {"ahead": ahead, "radius": radius, "coupled": coupled}
        last |= {"error": error, "around": around}
        carry = (k + 1, push, place, change, most, led_after, last, sigma)
        found = (
            jnp.max(error, axis=2),
            jnp.max(size, axis=1),
            jnp.max(acceleration + others[:, None], axis=1),
            jnp.max(led, axis=(0, 2)),
            jnp.max(estimate, axis=1),
            r * sigma,
        )
        return carry, found

    nil, both_sides = jnp.zeros((n, j)), jnp.zeros((2, n, j))
    last = {"aim": both_sides, "share": both_sides, "back": nil, "missed": nil, "bent": nil}
    last |= {"ahead": passing.ahead[0], "radius": passing.now[0], "coupled": nil}
    last |= {"error": side, "around": both_sides}
    sigma = jnp.zeros(())
    carry = (0, history, history, history, (nil, nil, nil), both_sides, last, sigma)
    inputs = (
        passing.now,
        passing.ahead,
        passing.free,
        passing.held,
        passing.stray,
        passing.bend,
        passing.heavy,
    )
    return jax.lax.scan(step, carry, inputs)[1]
