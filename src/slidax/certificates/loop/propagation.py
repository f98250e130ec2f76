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

from .aims import aimed_beside
from .kernels import ACCELERATION, ERROR, ESTIMATE, LAPSE, LED, MISSED, SHIFT, SLIP, SPEED

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Course:
    """What does not depend on time; units of periods, but for s and the inertia.

    - `surface`, `sides`: of the plan's equation; `slopes`: of its pull.
    - `period`: h [s]; `horizon`: H [periods]; `part`: of the delay that is not whole [periods].
    - `of_push`, `of_place`, `of_change`: sizes of responses, the newest last [9 n j L] each.
    - `tails`: what is older does at most, of pushes, places and changes, times the largest of it, faded.
    - `fading`: a period's share of that [n j].
    - `spread`: `|κ(t)/κ - 1|` at most, for each κ [n j]; `kappa`: these κ [n j].
    - `coupling`: of the joints' accelerations [n n].
    - `layer`: s0 of the reaching law [rad/s or m/s].
    """

    surface: Any
    sides: Any
    slopes: Any
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
    - `free`, `held`: responses to what is known, with noise, below and above zero in size [N 2 9 n j]: without p, and
      with the first p held. Of the acceleration both are the size.
    - `stray`: w* that is not known [N n], `bend`: by what the known one bends e off its mean [N n j], rad or m.
    - `target`, `eps`: x and ε of the ideal arm's plan [N n]; `turn`: `|Δx - ΔN ψ|` of it since the last sample [N n].
    - `sliding`: what the ideal arm remembers of s, `‖s‖` in the norm of M0 [N]; `s_next`: its |s⁺| [N n].
    - `root`: of the largest eigenvalue of M0 [N]; `mass`: |M0| [N n n]; `grown`: by which factor the norm of M0 grows
      to the next sample [N].
    """

    now: Any
    ahead: Any
    free: Any
    held: Any
    stray: Any
    bend: Any
    target: Any
    eps: Any
    turn: Any
    sliding: Any
    s_next: Any
    root: Any
    mass: Any
    grown: Any


jax.tree_util.register_dataclass(Passing, data_fields=list(Passing.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class First:
    """Bounds at the first sample.

    - `error`: of e, below and above zero [2 n].
    - `spread`: of p around what is held [n], `back`: of p - ŷ [n]; where that is inf `θ ŷ` is held, and what p may be
      beside it is added to the spread.
    - `slid`: of what s misses, in the norm of M0; `follows`: θ [n].
    """

    error: Any
    spread: Any
    back: Any
    slid: Any
    follows: Any

    @classmethod
    def of(cls, error: Floats, spread: Floats, back: Floats, slid: float = 0.0, follows: Floats | float = 1.0) -> First:
        """Of numbers."""
        each = jnp.broadcast_to(jnp.asarray(follows, float), back.shape)
        return cls(*(jnp.asarray(one) for one in (error, spread, back, slid, each)))


jax.tree_util.register_dataclass(First, data_fields=list(First.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class Bounds:
    """Bounds at each sample, the worst of all κ, of what the arms of a set do beside the ideal one.

    - `error`: of e where torques set in, below and above zero, in size [N 2 n].
    - `missed`: of ω [N n], `acceleration`: of ë [N n], in rad/period² or m/period²; `led`: of ŷ [N n].
    - `estimate`: of ŵ - w* [N n], in the same unit as ω; `speed`: of ė there [N n], rad or m per period; `lapse` and
      `shift`: of what the prediction misses of ė and of y [N n].
    - `needed`: what u must cover, ‖M0 s/H‖ [N], N m.
    """

    error: Floats
    missed: Floats
    acceleration: Floats
    led: Floats
    estimate: Floats
    speed: Floats
    lapse: Floats
    shift: Floats
    needed: Floats


def propagated(course: Course, passing: Passing, first: First) -> Bounds:
    """The bounds of all samples.

    - `course`, `passing`: the loop.
    - `first`: how it begins.
    """
    return Bounds(*(np.asarray(one) for one in _scanned(course, passing, first)))


def _norm(mass: Any, sizes: Any) -> Any:
    """In the norm of M0, of a vector whose entries are no larger."""
    return jnp.sqrt(sizes @ mass @ sizes)


@functools.partial(jax.jit)
def _scanned(course: Course, passing: Passing, first: First) -> Any:
    _, n, j, length = course.of_push.shape
    h, horizon = course.period, course.horizon
    r, lead = 1.0 / horizon, horizon - 0.5
    eta = 0.5 / lead
    side = jnp.broadcast_to(first.error[:, :, None], (2, n, j))
    # Each sample is written twice, a length apart, so that those before it always lie side by side.
    history = jnp.zeros((n, j, 2 * length))
    tail_push, tail_place, tail_change = course.tails

    def past(kernel: Any, tail: Any, history: Any, most: Any, k: Any) -> Any:
        """Of all samples before this; what is of it must be zero until it is known."""
        window = jax.lax.dynamic_slice_in_dim(history, k % length + 1, length, axis=2)
        return jnp.sum(kernel[..., :-1] * window[..., :-1], axis=-1) + tail * most

    def with_newest(history: Any, value: Any, k: Any) -> Any:
        place = k % length
        history = jax.lax.dynamic_update_index_in_dim(history, value, place, axis=2)
        return jax.lax.dynamic_update_index_in_dim(history, value, place + length, axis=2)

    def step(carry: Any, at: Passing) -> Any:
        k, push, place, change, most, led_next, last, slid = carry
        coupled_last, begun = last["coupled"], k > 0
        # 1. What is before this decision: ŷ, y - ŷ, e, ė.
        by_push = past(course.of_push, tail_push, push, most[0], k)
        by_place = past(course.of_place, tail_place, place, most[1], k)
        by_change = past(course.of_change, tail_change, change, most[2], k)
        own = course.part * (0.5 * course.part + lead) * coupled_last

        def either(output: int) -> Any:
            """From p itself, and from its changes: the less [2 n j]."""
            by_itself, by_turns = at.free[:, output] + by_place[output], at.held[:, output] + by_change[output]
            return jnp.minimum(by_itself, by_turns) + by_push[output]

        shift = jnp.max(either(SHIFT), axis=0) + own
        linear = at.free[:, LED] + by_push[LED] + by_place[LED]
        led = jnp.maximum(jnp.where(begun, jnp.minimum(led_next, linear), linear), 0.0)
        linear = at.free[:, ERROR] + by_push[ERROR] + by_place[ERROR] + 0.5 * course.part**2 * coupled_last
        around = led + shift
        mean = ((1.0 - eta) * last["error"] + eta * (last["around"] + around) + last["bent"]) / (1.0 + eta)
        error = jnp.where(begun, jnp.maximum(jnp.minimum(mean, linear), 0.0), side)
        speed = jnp.minimum(either(SPEED) + course.part * coupled_last, (around + error) / lead)
        # 2. s⁺ beside the ideal one: none, or what the boundary layer leaves where u covers twice what is missed.
        needed = at.root * (at.sliding + slid) / (horizon * h)
        s_bar = jnp.where(course.layer > 0.0, course.layer + at.s_next, 0.0)
        # 3. The place p that the plan aims at, and its change.
        target = led + (horizon * h * s_bar)[:, None]
        share, pull, ends = aimed_beside(
            course.surface, course.sides, at.now, horizon * h, (at.target, at.eps), target, last["ends"]
        )
        aim = at.ahead[:, None] * share
        most_aim, least_aim = jnp.max(aim, axis=0), jnp.max(aim + last["aim"][::-1], axis=0)
        was = jnp.max(last["share"], axis=0)
        low, high = jnp.min(ends[0], axis=1), jnp.max(ends[1], axis=1)
        flat, steep = course.slopes.between(jnp.minimum(low, last["low"]), jnp.maximum(high, last["high"]))
        follows = [(at.ahead / (at.now + horizon * h * one))[:, None] for one in (steep, flat)]
        bent = (follows[1] - follows[0]) * at.turn[:, None]
        quicker = (horizon * h * (s_bar + last["s_bar"]))[:, None]
        moved = r * (last["back"] + last["missed"])
        drawn = [jnp.abs((at.ahead - last["ahead"])[:, None] - f * (at.now - last["now"])[:, None]) for f in follows]
        turned = [f * (moved + quicker) + one * was for f, one in zip(follows, drawn, strict=True)]
        change_now = jnp.minimum(jnp.maximum(*turned) + bent, least_aim)
        # 3b. p - ŷ, from what it was and from what it may be.
        going = [
            jnp.abs(1.0 + (f - 1.0) * r) * last["back"]
            + jnp.abs(f - 1.0) * r * last["missed"]
            + f * quicker
            + one * was
            for f, one in zip(follows, drawn, strict=True)
        ]
        back = jnp.max(jnp.abs(at.ahead - at.now)[:, None] * share + horizon * h * pull, axis=0)
        back = back + (horizon * h * s_bar)[:, None]
        wide = jnp.maximum(*(jnp.abs(f - first.follows[:, None]) for f in follows)) * jnp.max(led, axis=0)
        wide = wide + follows[1] * (horizon * h * s_bar)[:, None]
        spread = first.spread[:, None] + jnp.where(jnp.isinf(first.back)[:, None], wide, 0.0)
        change_now = jnp.where(begun, change_now, spread)
        back = jnp.minimum(back, jnp.where(begun, jnp.maximum(*going) + bent, first.back[:, None]))
        change = with_newest(change, change_now, k)
        by_change = by_change + course.of_change[..., -1] * change_now
        by_place = by_place + course.of_place[..., -1] * most_aim
        place = with_newest(place, most_aim, k)
        # 4. The joint's acceleration, and with it what it does to itself and the others beyond the loop of one κ.
        strayed = course.kappa * at.stray[:, None]
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
        slip = _norm(at.mass, jnp.max(either(SLIP), axis=(0, 2))) / h
        # What is kept of s is a mean of what the velocity missed of its plans.
        slid_after = at.grown * ((1.0 - r) * slid + r * _norm(at.mass, s_bar) + slip)
        estimate = jnp.max(either(ESTIMATE), axis=0)
        size = jnp.max(missed, axis=0)
        last = {"aim": aim, "share": share, "back": back, "missed": size, "bent": at.bend + 0.25 * coupled}
        last |= {"ahead": at.ahead, "now": at.now, "coupled": coupled, "ends": ends, "low": low, "high": high}
        last |= {"error": error, "around": around, "s_bar": s_bar}
        carry = (k + 1, push, place, change, most, led_after, last, slid_after)
        found = (
            jnp.max(error, axis=2),
            jnp.max(size, axis=1),
            jnp.max(acceleration + others[:, None], axis=1),
            jnp.max(led, axis=(0, 2)),
            jnp.max(estimate, axis=1),
            jnp.max(speed, axis=(0, 2)),
            jnp.max(either(LAPSE) + course.part * coupled_last, axis=(0, 2)),
            jnp.max(shift, axis=1),
            needed,
        )
        return carry, found

    nil, both_sides, none = jnp.zeros((n, j)), jnp.zeros((2, n, j)), jnp.zeros(n)
    last = {"aim": both_sides, "share": both_sides, "back": nil, "missed": nil, "bent": nil}
    last |= {"ahead": passing.ahead[0], "now": passing.now[0], "coupled": nil, "s_bar": none}
    ends = jnp.broadcast_to(passing.eps[0][:, None], (2, n, j))
    last |= {"ends": ends, "low": passing.eps[0], "high": passing.eps[0]}
    last |= {"error": side, "around": both_sides}
    carry = (0, history, history, history, (nil, nil, nil), both_sides, last, first.slid)
    return jax.lax.scan(step, carry, passing)[1]
