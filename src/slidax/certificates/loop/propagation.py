"""Recursion of error bounds: each sample's bounds from earlier ones, for a law's loop with all its uncertainty.

docs/certificates/loop-rate.md has the inequalities, with the same letters, and their proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from ..each import Floats
from .aims import aimed_beside
from .kernels import ACCELERATION, ERROR, ESTIMATE, LAPSE, LED, MISSED, SHIFT, SLIP, SPEED

PUSH, PLACE, CHANGE = range(3)
"""Inputs of a loop: an acceleration, the target of its plan, and a change of that target."""


@dataclass(frozen=True)
class Course:
    """Constants of the recursion; units of periods, except for s and the inertia.

    - `surface`, `sides`: of the plan's equation; `slopes`: of the surface function.
    - `period`: h [s]; `horizon`: H [periods]; `part`: fractional part of the delay [periods].
    - `layer`: s0 of the reaching law [rad/s or m/s].
    """

    surface: Any
    sides: Any
    slopes: Any
    period: Any
    horizon: Any
    part: Any
    layer: Any


jax.tree_util.register_dataclass(Course, data_fields=list(Course.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class Passing:
    """Inputs of the recursion at each sample, first axis.

    - `now`, `ahead`: N and A [N n].
    - `free`, `held`: responses to known inputs, with noise, below and above zero in size [N 2 9 n j]: without p, and
      with the first p held. For the acceleration both are the size.
    - `stray`: unknown part of w* [N n]; `bend`: curvature effect of its known part on e [N n j], rad or m.
    - `target`, `eps`: x and ε of the nominal run's plan [N n]; `turn`: `|Δx - ΔN ψ|` since the last sample [N n].
    - `sliding`: `‖s‖` of the nominal run in the norm of M0 [N]; `s_next`: its |s⁺| [N n].
    - `root`: root of the largest eigenvalue of M0 [N]; `mass`: |M0| [N n n]; `grown`: growth of the norm of M0 to the
      next sample [N].
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
    - `spread`: of p around the held value [n]; `back`: of p - ŷ [n]. Where `back` is inf, `θ ŷ` is held, and the
      deviation of p from it is added to the spread.
    - `slid`: of the error of s, in the norm of M0; `follows`: θ [n].
    """

    error: Any
    spread: Any
    back: Any
    slid: Any
    follows: Any

    @classmethod
    def of(cls, error: Floats, spread: Floats, back: Floats, slid: float = 0.0, follows: Floats | float = 1.0) -> First:
        each = jnp.broadcast_to(jnp.asarray(follows, float), back.shape)
        return cls(*(jnp.asarray(value) for value in (error, spread, back, slid, each)))


jax.tree_util.register_dataclass(First, data_fields=list(First.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class Bounds:
    """Bounds at each sample, over all κ, of the deviation of a set's members from the nominal run.

    - `error`: of e when torques start, below and above zero, in size [N 2 n].
    - `missed`: of ω [N n], `acceleration`: of ë [N n], in rad/period² or m/period²; `led`: of ŷ [N n].
    - `estimate`: of ŵ - w* [N n], in the same unit as ω; `speed`: of ė there, below and above zero [N 2 n], rad or m
      per period; `lapse` and `shift`: prediction errors of ė and of y [N n].
    - `needed`: u that is required, ‖M0 s/H‖ [N], N m.
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


def in_norm(mass: Any, sizes: Any) -> Any:
    """Bound of a vector's norm in M0 from bounds of its entries."""
    return jnp.sqrt(sizes @ mass @ sizes)


@dataclass(frozen=True)
class Answers:
    """Responses of the loops to the inputs of a sample.

    - `before`: present effect of all earlier inputs: accelerations, targets, changes of target [9 n j] each.
    - `newest`: from the kind of input and its size now [n j] to its immediate effect [9 n j].
    - `pushed`: from bounds of each joint's acceleration to those of its unmodelled part and of ë [n j] each.
    """

    before: tuple[Any, Any, Any]
    newest: Callable[[int, Any], Any]
    pushed: Callable[[Any], tuple[Any, Any]]


def sampled(course: Course, first: First, at: Passing, begun: Any, carried: Any, answers: Answers) -> Any:
    """One step: the carry for the next sample, the inputs (accelerations, targets, changes [n j] each), and `Bounds`.

    - `begun`: False at the first sample.
    """
    h, horizon = course.period, course.horizon
    r, lead = 1.0 / horizon, horizon - 0.5
    eta = 0.5 / lead
    led_next, last, slid = carried
    coupled_last, side = last["coupled"], last["begun_at"]
    # 1. State before this decision: ŷ, y - ŷ, e, ė.
    by_push, by_place, by_change = answers.before
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
    # ė = (y - e)/c, so that y above and e below zero go together.
    speed = jnp.minimum(either(SPEED) + course.part * coupled_last, (around + error[::-1]) / lead)
    speed = jnp.maximum(speed, 0.0)
    # 2. Deviation of s⁺ from the nominal run: none, or the rest in the boundary layer if u covers twice the error.
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
    follows = [(at.ahead / (at.now + horizon * h * change))[:, None] for change in (steep, flat)]
    bent = (follows[1] - follows[0]) * at.turn[:, None]
    quicker = (horizon * h * (s_bar + last["s_bar"]))[:, None]
    moved = r * (last["back"] + last["missed"])
    drawn = [jnp.abs((at.ahead - last["ahead"])[:, None] - f * (at.now - last["now"])[:, None]) for f in follows]
    turned = [f * (moved + quicker) + change * was for f, change in zip(follows, drawn, strict=True)]
    change_now = jnp.minimum(jnp.maximum(*turned) + bent, least_aim)
    # 3b. p - ŷ, from what it was and from what it may be.
    going = [
        jnp.abs(1.0 + (f - 1.0) * r) * last["back"] + jnp.abs(f - 1.0) * r * last["missed"] + f * quicker + change * was
        for f, change in zip(follows, drawn, strict=True)
    ]
    back = jnp.max(jnp.abs(at.ahead - at.now)[:, None] * share + horizon * h * pull, axis=0)
    back = back + (horizon * h * s_bar)[:, None]
    wide = jnp.maximum(*(jnp.abs(f - first.follows[:, None]) for f in follows)) * jnp.max(led, axis=0)
    wide = wide + follows[1] * (horizon * h * s_bar)[:, None]
    spread = first.spread[:, None] + jnp.where(jnp.isinf(first.back)[:, None], wide, 0.0)
    change_now = jnp.where(begun, change_now, spread)
    back = jnp.minimum(back, jnp.where(begun, jnp.maximum(*going) + bent, first.back[:, None]))
    by_change = by_change + answers.newest(CHANGE, change_now)
    by_place = by_place + answers.newest(PLACE, most_aim)
    # 4. The joint's acceleration, and with it what it does to itself and the others beyond the loop of one κ.
    coupled, accelerated = answers.pushed(jnp.max(either(ACCELERATION), axis=0))
    both = jnp.where(course.part > 0, jnp.maximum(coupled, coupled_last), coupled)
    by_push = by_push + answers.newest(PUSH, both)
    # 5. The next ŷ and s.
    missed = either(MISSED)
    led_after = (1.0 - r) * led + r * jnp.maximum(aim + missed, 0.0)
    slip = in_norm(at.mass, jnp.max(either(SLIP), axis=(0, 2))) / h
    # The remembered s is a mean of the velocity's deviations from its plans.
    slid_after = at.grown * ((1.0 - r) * slid + r * in_norm(at.mass, s_bar) + slip)
    estimate = jnp.max(either(ESTIMATE), axis=0)
    size = jnp.max(missed, axis=0)
    last = {"aim": aim, "share": share, "back": back, "missed": size, "bent": at.bend + 0.25 * coupled}
    last |= {"ahead": at.ahead, "now": at.now, "coupled": coupled, "ends": ends, "low": low, "high": high}
    last |= {"error": error, "around": around, "s_bar": s_bar, "begun_at": side}
    bounds = (
        jnp.max(error, axis=2),
        jnp.max(size, axis=1),
        jnp.max(accelerated, axis=1),
        jnp.max(led, axis=(0, 2)),
        jnp.max(estimate, axis=1),
        jnp.max(speed, axis=2),
        jnp.max(either(LAPSE) + course.part * coupled_last, axis=(0, 2)),
        jnp.max(shift, axis=1),
        needed,
    )
    return (led_after, last, slid_after), (both, most_aim, change_now), bounds


def carried_at_first(passing: Passing, first: First, cells: int) -> Any:
    """Return the carry of the first sample.

    - `cells`: j.
    """
    n = first.spread.size
    nil, both_sides, none = jnp.zeros((n, cells)), jnp.zeros((2, n, cells)), jnp.zeros(n)
    side = jnp.broadcast_to(first.error[:, :, None], both_sides.shape)
    last = {"aim": both_sides, "share": both_sides, "back": nil, "missed": nil, "bent": nil}
    last |= {"ahead": passing.ahead[0], "now": passing.now[0], "coupled": nil, "s_bar": none}
    ends = jnp.broadcast_to(passing.eps[0][:, None], both_sides.shape)
    last |= {"ends": ends, "low": passing.eps[0], "high": passing.eps[0]}
    last |= {"error": side, "around": both_sides, "begun_at": side}
    return both_sides, last, first.slid
