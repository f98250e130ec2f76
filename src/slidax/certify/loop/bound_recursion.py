"""The recursion of all error bounds from sample to sample, and its inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import maximum_filter1d

from slidax.law.error_transformations import psi

from ..arm.demand import Demand
from ..sampled_scenario import Floats
from .envelope import SampledEnvelope, SlopeTable, map_rows, plan_deviation
from .initial_set import NominalRun
from .joint_responses import ACCELERATION, ERROR, ESTIMATE, LAPSE, LED, MISSED, SHIFT, SLIP, SPEED
from .problem import LoopProblem, SensorNoise
from .sliding_variable import SlidingVariableBounds

DISTURBANCE, TARGET, CHANGE = range(3)
"""Inputs of a loop: an acceleration, the target of its plan, and a change of that target."""


@dataclass(frozen=True)
class LoopConstants:
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


jax.tree_util.register_dataclass(LoopConstants, data_fields=list(LoopConstants.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class StepInputs:
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


jax.tree_util.register_dataclass(StepInputs, data_fields=list(StepInputs.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class InitialBounds:
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
    def of(
        cls, error: Floats, spread: Floats, back: Floats, slid: float = 0.0, follows: Floats | float = 1.0
    ) -> InitialBounds:
        each = jnp.broadcast_to(jnp.asarray(follows, float), back.shape)
        return cls(*(jnp.asarray(value) for value in (error, spread, back, slid, each)))


jax.tree_util.register_dataclass(InitialBounds, data_fields=list(InitialBounds.__dataclass_fields__), meta_fields=[])


@dataclass(frozen=True)
class ErrorBounds:
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


def norm_bound(mass: Any, sizes: Any) -> Any:
    """Bound of a vector's norm in M0 from bounds of its entries."""
    return jnp.sqrt(sizes @ mass @ sizes)


@dataclass(frozen=True)
class LoopResponses:
    """Responses of the loops to the inputs of a sample.

    - `before`: present effect of all earlier inputs: accelerations, targets, changes of target [9 n j] each.
    - `newest`: from the kind of input and its size now [n j] to its immediate effect [9 n j].
    - `split_acceleration`: from bounds of each joint's acceleration to those of its unmodelled part and ë [n j].
    """

    before: tuple[Any, Any, Any]
    newest: Callable[[int, Any], Any]
    split_acceleration: Callable[[Any], tuple[Any, Any]]


def bound_step(
    course: LoopConstants, first: InitialBounds, at: StepInputs, begun: Any, carried: Any, answers: LoopResponses
) -> Any:
    """One step: the carry for the next sample, the inputs (accelerations, targets, changes [n j] each), and `Bounds`.

    - `begun`: False at the first sample.
    """
    h, horizon = course.period, course.horizon
    r, lead = 1.0 / horizon, horizon - 0.5
    eta = 0.5 / lead
    led_next, last, slid = carried
    coupled_last, side = last["coupled"], last["begun_at"]
    # 1. State before this decision: ŷ, y - ŷ, e, ė.
    by_disturbance, by_place, by_change = answers.before
    own = course.part * (0.5 * course.part + lead) * coupled_last

    def either(output: int) -> Any:
        """From p itself, and from its changes: the less [2 n j]."""
        by_itself, by_turns = at.free[:, output] + by_place[output], at.held[:, output] + by_change[output]
        return jnp.minimum(by_itself, by_turns) + by_disturbance[output]

    shift = jnp.max(either(SHIFT), axis=0) + own
    linear = at.free[:, LED] + by_disturbance[LED] + by_place[LED]
    led = jnp.maximum(jnp.where(begun, jnp.minimum(led_next, linear), linear), 0.0)
    linear = at.free[:, ERROR] + by_disturbance[ERROR] + by_place[ERROR] + 0.5 * course.part**2 * coupled_last
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
    share, phi, ends = plan_deviation(
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
    back = jnp.max(jnp.abs(at.ahead - at.now)[:, None] * share + horizon * h * phi, axis=0)
    back = back + (horizon * h * s_bar)[:, None]
    wide = jnp.maximum(*(jnp.abs(f - first.follows[:, None]) for f in follows)) * jnp.max(led, axis=0)
    wide = wide + follows[1] * (horizon * h * s_bar)[:, None]
    spread = first.spread[:, None] + jnp.where(jnp.isinf(first.back)[:, None], wide, 0.0)
    change_now = jnp.where(begun, change_now, spread)
    back = jnp.minimum(back, jnp.where(begun, jnp.maximum(*going) + bent, first.back[:, None]))
    by_change = by_change + answers.newest(CHANGE, change_now)
    by_place = by_place + answers.newest(TARGET, most_aim)
    # 4. The joint's acceleration, and with it what it does to itself and the others beyond the loop of one κ.
    coupled, accelerated = answers.split_acceleration(jnp.max(either(ACCELERATION), axis=0))
    both = jnp.where(course.part > 0, jnp.maximum(coupled, coupled_last), coupled)
    by_disturbance = by_disturbance + answers.newest(DISTURBANCE, both)
    # 5. The next ŷ and s.
    missed = either(MISSED)
    led_after = (1.0 - r) * led + r * jnp.maximum(aim + missed, 0.0)
    slip = norm_bound(at.mass, jnp.max(either(SLIP), axis=(0, 2))) / h
    # The remembered s is a mean of the velocity's deviations from its plans.
    slid_after = at.grown * ((1.0 - r) * slid + r * norm_bound(at.mass, s_bar) + slip)
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


def initial_carry(passing: StepInputs, first: InitialBounds, cells: int) -> Any:
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


SPARE = 8
"""Samples by which compiled arrays may be longer than the run."""


@dataclass(frozen=True)
class CertifiedBounds:
    """Error bounds of a scenario.

    - `narrowing`: its envelope, when torques start.
    - `bounds`: at these times.
    - `error`: of e itself, below and above zero, in size [N 2 n].
    - `share`: bound of the error over the envelope's side, at each sample of the run [N n]; below 1 it holds.
    - `kappa`, `spread`: κ [n j], and the covered deviation around each [n j].
    - `noise`: the noise's part in the bound of e [n], rad or m.
    """

    subject: LoopProblem
    narrowing: SampledEnvelope
    bounds: ErrorBounds
    error: Floats
    share: Floats
    kappa: Floats
    spread: Floats
    noise: Floats


@dataclass(frozen=True)
class BoundStart:
    """Where the bound begins.

    - `ideal`: the nominal run from there.
    - `states`, `slid`: deviations of other members from it, as in `Entry`.
    """

    ideal: NominalRun
    states: Floats
    slid: Floats


class BoundProblem:
    """The part of a bound that does not depend on decoupled or coupled loops.

    - `demand`: of a set of arms along the nominal run, or else along the reference.
    - `since`: the initial set with the nominal run. Without it the bound starts with the scenario's start and
      reference, and s counts as reached.
    """

    def __init__(self, subject: LoopProblem, demand: Demand, since: BoundStart | None = None) -> None:
        self.subject, self.demand, self.requested = subject, demand.boxed(), demand
        self.since, self.ideal = since, None if since is None else since.ideal
        law = subject.law
        assert law.horizon is not None
        h = self.period = float(law.period)
        self.horizon = float(law.horizon)
        # From the first sample of the arm that is followed to when the first torque sets in.
        quiet = 0 if since is None else subject.quiet
        self.late = quiet + int(subject.dead_time)
        self.samples = demand.times.size - self.late - 2
        self.set_in = demand.times[0] + (np.arange(self.samples) + quiet + subject.dead_time) * h
        self.e, self.de, self.ddq = subject.start()
        self.sides: Any = subject.drawn.init(jnp.zeros(()), jnp.asarray(self.e))
        self.quiet = subject.quiet if since is None else 0
        self.noise = SensorNoise.of(subject.scenario, law.joints)
        self.most = round(subject.scenario.t1 / h) + SPARE
        self.narrowing = SampledEnvelope.of(
            subject.drawn, self.sides, period=h, horizon=self.horizon, times=self.set_in, most=self.most
        )
        self.sliding = SlidingVariableBounds.of(subject, self.ideal, self.set_in, self.most)
        self.course = self._course()

    @property
    def lumped(self) -> Floats:
        """‖M0 w*‖ when each torque starts, the largest of all members [N], N m."""
        first = self.late
        disturbance = self.demand.disturbance[:, first : first + self.samples]
        sizes = np.linalg.norm(np.einsum("kij,mkj->mki", self.sliding.inertia, disturbance), axis=2).max(axis=0)
        if self.requested.effects is not None and self.requested.effects.shape[1]:
            parts = self.requested.effects[:, :, first : first + self.samples]
            each = np.linalg.norm(np.einsum("kij,mekj->meki", self.sliding.inertia, parts), axis=3)
            sizes = sizes + each.sum(axis=1).max(axis=0)
        return sizes

    def reach(self, certified: CertifiedBounds) -> tuple[Floats, Floats, Floats, Floats]:
        """Deviation of the arm from the nominal run around each of its samples, and its prediction errors.

        Position [K n], velocity below and above zero [2 K n], and prediction errors of both [K n] each; rad or m, and
        rad/s or m/s.
        """
        bounds, h = certified.bounds, self.period
        within = bounds.acceleration
        radius = np.max(bounds.error, axis=1) + within / 8.0
        below, above = ((bounds.speed[:, side] + within) / h for side in (0, 1))
        missed = bounds.shift + (self.horizon / h - 0.5) * bounds.lapse
        # No deviation before the first torque starts; periods begin and end at torques, samples lie in between.
        late = self.late + int(self.subject.dead_time % 1.0 > 0)
        spans = []
        for size in (radius, below, above, missed, bounds.lapse / h):
            grown = np.maximum(size, np.concatenate([size[1:], size[-1:]]))
            whole = np.concatenate([np.repeat(grown[:1], late, axis=0), grown])
            count = self.demand.times.size
            whole = np.concatenate([whole, np.repeat(whole[-1:], max(count - len(whole), 0), axis=0)])[:count]
            spans.append(np.maximum(whole, np.concatenate([whole[1:], whole[-1:]])))
        return spans[0], np.stack(spans[1:3]), spans[3], spans[4]

    def _course(self) -> LoopConstants:
        return LoopConstants(
            surface=self.subject.surface,
            sides=self.sides,
            slopes=SlopeTable.of(self.subject.surface, self.sides),
            period=jnp.asarray(self.period),
            horizon=jnp.asarray(self.horizon / self.period),
            part=jnp.asarray(self.subject.law.delay % 1.0),
            layer=jnp.asarray(self.subject.cover()[1], float),
        )

    def error_of(self, bounds: ErrorBounds) -> tuple[Floats, Floats]:
        """Bounds of e itself, below and above zero [N 2 n], and their share of the envelope at each sample [N n]."""
        error = bounds.error
        if self.ideal is not None:
            middle = self.ideal.error[: self.samples]
            error = np.maximum(np.stack([bounds.error[:, 0] - middle, bounds.error[:, 1] + middle], axis=1), 0.0)
        return error, self._share(error, bounds)

    def strayed(self, more: Floats | None) -> Floats:
        """Unknown part of w* in the period of each decision [N n], in units of periods.

        - `more`: beyond `demand.stray`, at each sample of the arm [N n], rad/s² or m/s².
        """
        disturbance, first, n = self.demand.disturbance, self.late, self.samples
        stray = np.broadcast_to(self.demand.stray, disturbance.shape[1:]) + (0.0 if more is None else more)
        if self.ideal is None:
            # Between two samples w* is off the line by an eighth of its second difference.
            curved = np.zeros(disturbance.shape[1:])
            if disturbance.shape[1] > 2:
                curved[1:-1] = np.max(np.abs(np.diff(disturbance, 2, axis=1)), axis=0) / 8.0
                curved[:-1] = np.maximum(curved[:-1], curved[1:])
            stray = stray + curved
        later = np.concatenate([stray, np.repeat(stray[-1:], 3, axis=0)]) * self.period**2
        return np.array([later[first + k : first + k + n] for k in range(3)]).max(axis=0)

    def recent(self, sizes: Floats, length: int) -> Floats:
        """The largest recent value [N n], in units of periods.

        - `sizes`: at each sample of the arm [N n], rad/s² or m/s².
        - `length`: of the loop's memory, in periods.
        """
        size = np.concatenate([sizes[self.late :], np.repeat(sizes[-1:], self.late, axis=0)])[: self.samples]
        # Of each window the last sample is the newest.
        window: Floats = maximum_filter1d(size, length, axis=0, mode="nearest", origin=(length - 1) // 2)
        return self.period**2 * window

    def planned(self) -> tuple[Floats, Floats, Floats]:
        """The nominal run's x and ε, and `|Δx - ΔN ψ|` from the sample before [N n]."""
        n, narrowing = self.samples, self.narrowing
        if self.ideal is None:
            return (np.zeros((n, self.e.size)),) * 3
        eps = self.ideal.eps[:n]
        psi_b, phi = map_rows(_psi_and_phi, eps, self.most, self.sides, self.subject.surface)
        planned_target = self.ideal.target
        target = narrowing.now * psi_b + self.horizon * phi if planned_target is None else planned_target[:n]
        turn = np.zeros_like(target)
        turn[1:] = np.abs(np.diff(target, axis=0) - np.diff(narrowing.now, axis=0) * psi_b[:-1])
        return target, eps, turn

    def _share(self, error: Floats, bounds: ErrorBounds) -> Floats:
        """The bound over the envelope's side at each sample of the run, from the first torque on."""
        part = self.subject.dead_time % 1.0
        times = self.set_in
        if part > 0:
            # A sample lies between two settings in; there e is off the line between them by h² ë/8 at most.
            off = bounds.acceleration[:-1, None] / 8.0
            error = np.maximum(error[:-1], error[1:]) + off
            times = self.set_in[:-1] + (1.0 - part) * self.period
        radius = map_rows(_radius, times, self.most, self.subject.drawn.performance, self.e)
        sides = np.stack([-np.asarray(self.sides.lower), np.asarray(self.sides.upper)])
        return np.max(error / (sides[None] * radius[:, None]), axis=1)


@eqx.filter_jit
def _psi_and_phi(sides: Any, surface: Any, eps: Any) -> tuple[Any, Any]:
    """ψ and φ at each ε."""
    return jax.vmap(lambda value: (psi(value, sides), surface.phi_and_slope(value)[0]))(eps)


@eqx.filter_jit
def _radius(performance: Any, like: Any, times: Any) -> Any:
    return jax.vmap(lambda t: jnp.broadcast_to(performance.radius(t), like.shape))(times)
