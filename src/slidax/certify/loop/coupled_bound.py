"""Coupled bound: the time-varying coupling K is known, and only its uncertainty enters as a disturbance."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..arm.demand import Demand
from ..arm.hull import SetPart
from ..sampled_scenario import Floats
from .bound_recursion import (
    BoundProblem,
    BoundStart,
    CertifiedBounds,
    ErrorBounds,
    InitialBounds,
    LoopConstants,
    LoopResponses,
    StepInputs,
    bound_step,
    initial_carry,
)
from .coupled_loop import LoopsAlongMotion, adjoint_responses
from .coupled_responses import CoupledResponses, KnownOutputs, initial_columns, loop_memory
from .joint_responses import ERROR, LED, OUTPUTS
from .problem import LoopProblem


@dataclass(frozen=True)
class CoupledLoops:
    """The coupled loop along time; units of periods.

    - `kernels`: of the decisions, one for each `width` of them.
    - `size`: |K| of the model in each decision's period [N n n].
    - `off`: deviation of K from it [N n n].
    - `under_way`: bounds of `a + w*` of the commands decided before the first, the newest first [Q n].
    """

    kernels: CoupledResponses
    width: int
    size: Floats
    off: Floats
    under_way: Floats

    @property
    def which(self) -> NDArray[np.integer[Any]]:
        """The number of each decision's responses [N]."""
        return np.arange(len(self.off)) // self.width

    def before(self, acceleration: Floats, stray: Floats, aims: Floats, changes: Floats, part: float) -> Floats:
        """Effect of all inputs before each decision [N 3 9 n], for bounds of these inputs.

        - `acceleration`: of each joint's `a + w*` [N n]; `stray`: of the unknown part of w* [N n].
        - `aims`, `changes`: of p, and of its changes [N n].
        - `part`: fractional part of the delay.
        """
        count, n = aims.shape
        answers = np.empty((count, 3, OUTPUTS, n))
        disturbances = np.einsum("kij,kj->ki", self.off, acceleration + stray) + np.einsum(
            "kij,kj->ki", self.size, stray
        )
        if part > 0:
            disturbances[1:] = np.maximum(disturbances[1:], disturbances[:-1])
        begun = self.under_way @ self.off[0].T
        for kind, (values, first) in enumerate(((disturbances, begun), (aims, None), (changes, None))):
            recent = self._recent(values, first)
            most = np.maximum.accumulate(values, axis=0)
            if first is not None:
                most = np.maximum(most, first.max(axis=0))
            for number in range(len(self.kernels.tails)):
                at = slice(number * self.width, min((number + 1) * self.width, count))
                older = self.kernels.older[kind, number]
                answer = np.tensordot(recent[at], older, axes=([1, 2], [0, 2]))
                answer += most[at] @ self.kernels.tails[number].T
                answers[at, kind] = answer.reshape(-1, OUTPUTS, n)
        return answers

    def _recent(self, values: Floats, before: Floats | None) -> Floats:
        """The largest value in each group of lags, for each decision [N B n]."""
        longest = self.kernels.longest
        padded = np.concatenate([np.zeros((longest, values.shape[1])), values])
        if before is not None:
            padded[longest - len(before) : longest] = before[::-1]
        count = len(values)
        recent, widest = [], {}
        for lags in self.kernels.lumps:
            width = len(lags)
            if width not in widest:
                # At i the largest of those from i on.
                widest[width] = np.max([padded[k : len(padded) - width + 1 + k] for k in range(width)], axis=0)
            first = longest - lags[-1]
            recent.append(widest[width][first : first + count])
        return np.stack(recent, axis=1)


def propagate_coupled(
    course: LoopConstants, together: CoupledLoops, passing: StepInputs, first: InitialBounds, before: Floats
) -> tuple[ErrorBounds, Floats, Floats, Floats]:
    """Return the bounds of all samples, and their inputs: each joint's `a + w*`, targets, changes [N n].

    - `before`: from `Together.before`.
    """
    _, count, _, n = together.kernels.newest.shape
    newest = jnp.asarray(together.kernels.newest.reshape(3, count, OUTPUTS, n, n).swapaxes(0, 1))
    inputs = (together.size, together.which, together.off, before)
    rows, came = _scanned(course, passing, first, newest, *(jnp.asarray(value) for value in inputs))
    bounds = ErrorBounds(*(np.asarray(value) for value in rows))
    acceleration, aims, changes = (np.asarray(value) for value in came)
    return bounds, acceleration, aims, changes


@functools.partial(jax.jit)
def _scanned(
    course: LoopConstants,
    passing: StepInputs,
    first: InitialBounds,
    newest: Any,
    size: Any,
    which: Any,
    off: Any,
    before: Any,
) -> Any:
    def step(carry: Any, inputs: Any) -> Any:
        k, carried = carry
        at, known_size, number, lacking, past = inputs
        known: list[Any] = []

        def split_acceleration(acceleration: Any) -> tuple[Any, Any]:
            known.append(acceleration[:, 0])
            moved = acceleration[:, 0] + at.stray
            others = lacking @ moved
            return (others + known_size @ at.stray)[:, None], (others + known_size @ moved)[:, None]

        answers = LoopResponses(
            before=(past[0][..., None], past[1][..., None], past[2][..., None]),
            newest=lambda kind, value: (newest[number, kind] @ value[:, 0])[..., None],
            split_acceleration=split_acceleration,
        )
        carried, entered, bounds = bound_step(course, first, at, k > 0, carried, answers)
        return (k + 1, carried), (bounds, (known[0], entered[1][:, 0], entered[2][:, 0]))

    carry = (0, initial_carry(passing, first, 1))
    return jax.lax.scan(step, carry, (passing, size, which, off, before))[1]


_FILTERS = (minimum_filter1d, maximum_filter1d)

SPARE = 0.002
"""Relative deviation of each entry of K from the line between two evaluated samples."""

ABOVE = 1.05
"""Factor by which each round enlarges its result, so that the next may confirm it."""


class CoupledProblem(BoundProblem):
    """Error bounds of a part of a set for given disturbance bounds, reusable across fixed-point iterations.

    - `demand`: of the whole set.
    - `part`: the members.
    - `chance`: probability that normal noise exceeds its bound at some sample of the run.
    - `width`: decisions that share one response.
    """

    def __init__(
        self, subject: LoopProblem, demand: Demand, since: BoundStart, part: SetPart, chance: float, width: int
    ) -> None:
        super().__init__(subject, demand, since)
        self.width = width
        # Effects of uncertain values stay signals, each with its part of the set.
        self.demand = self.requested
        ideal = since.ideal
        nothing = np.zeros_like(demand.disturbance[0])
        self.shared = nothing if ideal.disturbance is None else ideal.disturbance
        self.rest = nothing if ideal.rest is None else ideal.rest
        self.part, loops = part, subject.loops
        n, late = self.samples, self.late
        # Of each period of the arm.
        low, high = np.minimum(part.low[:-1], part.low[1:]), np.maximum(part.high[:-1], part.high[1:])
        self.along = LoopsAlongMotion(loops, 0.5 * (low + high))
        self.forgetting = loop_memory(self.along, n)
        self.confirmed = False
        self.together: CoupledLoops | None = None
        if self.forgetting.memory is None:
            return
        least, most = (values(self.along.matrices, width + 1, axis=0, mode="nearest") for values in _FILTERS)
        off = np.maximum(high - least, most - low) + SPARE * np.maximum(np.abs(low), np.abs(high))
        size = np.maximum(np.abs(least), np.abs(most))
        # A torque sets in at a sample or between two, and lasts for a period.
        ends = [slice(late + k, late + k + n) for k in range(1 + (subject.dead_time % 1.0 > 0))]
        queue = self.along.own - 8
        states = np.abs(since.states).max(axis=0)
        # Of a command under way: what it is planned to do, and what the estimate misses.
        under_way = states[2 : 2 + queue] + states[4 + queue]
        kernels = self._know(chance)
        off, size = (np.array([values[end] for end in ends]).max(axis=0) for values in (off, size))
        self.together = CoupledLoops(kernels, width, size, off, under_way)
        self.slope = np.max([part.slope[late + k : late + k + n] for k in range(len(ends) + 1)], axis=0)
        self.assumed, self.tube = np.zeros((3, n, len(loops))), np.zeros_like(part.disturbance[0])

    @property
    def stable(self) -> bool:
        """True if the coupled loop is stable along the motion."""
        return self.together is not None

    def certified(self, more: Floats | None = None, misread: Floats | None = None) -> CertifiedBounds:
        """The bounds, from the inputs of the last round: true if that is `confirmed`."""
        assert self.together is not None
        stray = self.strayed(self.rest if more is None else more + self.rest)
        free, held = self.free, self.held
        if misread is not None:
            extra = self._misled(misread)[:, None, :, :, None]
            free, held = free + extra, held + extra
        target, eps, turn = self.planned()
        narrowing, sliding = self.narrowing, self.sliding
        inputs = (narrowing.now, narrowing.ahead, free, held, stray, self.bend[:, :, None], target, eps, turn)
        reached = (sliding.size, sliding.s_next, sliding.root, sliding.mass, sliding.grown)
        passing = StepInputs(*(jnp.asarray(values) for values in (*inputs, *reached)))
        acceleration, aims, changes = self.assumed
        tube = np.maximum(
            self.tube[self.late : self.late + len(stray)], self.tube[self.late + 1 : self.late + 1 + len(stray)]
        )
        around = self.together.off + np.einsum("kijl,kl->kij", self.slope, tube)
        together = replace(self.together, off=around)
        before = together.before(acceleration, stray, aims, changes, self.subject.dead_time % 1.0)
        bounds, *came = propagate_coupled(self.course, together, passing, self.first, before)
        error, share = self.error_of(bounds)
        middle = np.sqrt(np.prod(self.demand.kappa, axis=0))[:, None]
        joints = len(middle)
        noise = self.noise_size[:, ERROR * joints : (ERROR + 1) * joints].max(axis=0)
        certified = CertifiedBounds(
            self.subject, self.narrowing, bounds, error, share, middle, np.zeros_like(middle), noise
        )
        radius = self.reach(certified)[0]
        self.confirmed = bool((np.array(came) <= self.assumed).all() and (radius <= self.tube).all())
        self.assumed = np.maximum(self.assumed, ABOVE * np.array(came))
        self.tube = np.maximum(self.tube, ABOVE * radius)
        return certified

    def _know(self, chance: float) -> CoupledResponses:
        """Compute the known responses of the loops, and bounds at the first sample."""
        assert self.since is not None
        assert self.forgetting.memory is not None
        n, h, loops, memory = self.samples, self.period, self.subject.loops, self.forgetting.memory
        joints, part = len(loops), self.subject.dead_time % 1.0
        slope = self.course.slopes.between(*(jnp.asarray(self.since.ideal.eps[0]),) * 2)[0]
        follows = self.narrowing.ahead[0] / (self.narrowing.now[0] + self.horizon * np.asarray(slope))
        disturbances = np.concatenate([self.part.disturbance - self.shared, self.part.effects]) * h * h
        decisions = np.arange(0, n, self.width) + self.width // 2
        kernels = CoupledResponses(self.along, len(decisions), memory)
        starts = initial_columns(self.along, loops, follows, self.since.states)
        known = KnownOutputs(self.along, decisions, self.width, disturbances, starts, memory)
        for back in adjoint_responses(self.along, decisions, memory):
            kernels.take(back)
            known.take(back)
        kernels.finish()
        known.finish(kernels.later)
        sizes, bend = known.told(n, len(self.part.disturbance), self.late, part > 0)
        self.bend = bend / (12.0 if part == 0 else 4.0)
        # Disturbances of long ago differ by no more than this from what they are taken as.
        older = 2.0 * (
            np.abs(disturbances[: len(self.part.disturbance)]).max()
            + np.abs(disturbances[len(self.part.disturbance) :]).sum(axis=0).max(initial=0.0)
        )
        widest = max(1.0, float(np.abs(self.along.matrices).sum(axis=2).max()))
        self.noise_size = self._noise(kernels, n * joints * OUTPUTS, chance)
        extra = (self.noise_size + 2.0 * widest * older * kernels.tails[..., 0])[np.arange(n) // self.width]
        self.free, self.held = (
            (sizes + (extra + known_sizes.reshape(-1, extra.shape[1])[:n]).reshape(n, 1, OUTPUTS, joints))[..., None]
            for known_sizes in (known.free, known.held)
        )
        slid = np.abs(self.since.slid)
        size = float(np.sqrt(slid @ self.sliding.mass[0] @ slid))
        error, led = self.free[0, :, ERROR, :, 0], self.free[0, :, LED, :, 0].max(axis=0)
        self.first = InitialBounds.of(error, led, np.full_like(led, np.inf), size, follows)
        return kernels

    def _noise(self, kernels: CoupledResponses, times: int, chance: float) -> Floats:
        """Effect of the sensors' noise on each output [Z 9n], as `Noise.size` for one joint's loop."""
        noise, h = self.noise, self.period
        position, velocity = noise.position_deviation**2, (h * noise.velocity_deviation) ** 2
        spread = np.sqrt(kernels.noise_square[0] @ position + kernels.noise_square[1] @ velocity)
        return kernels.noise[0] @ noise.position + noise.deviations(times, chance) * spread

    def _misled(self, misread: Floats) -> Floats:
        """Bound of the effect of commands computed for wrong predictions [N 9 n]."""
        assert self.together is not None
        kernels, which = self.together.kernels, self.together.which
        extra: Floats = np.einsum("koj,kj->ko", kernels.of_command[which], self.recent(misread, kernels.longest))
        if self.demand.relearning is not None:
            relearnt = self.recent(self.demand.relearning, kernels.longest)
            extra = extra + np.einsum("koj,kj->ko", kernels.of_estimate[which], relearnt)
        return extra.reshape(len(extra), OUTPUTS, -1)
