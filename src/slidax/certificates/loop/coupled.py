"""Error bounds of a part of a set with all joints as one loop, which keeps the phase between joints."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..arm.part import Part
from ..demand import Demand
from ..each import Floats
from .adjoint import Along, carried_back
from .coupled_kernels import CoupledKernels, forgetting
from .coupled_known import CoupledKnown, beginnings
from .kernels import ERROR, LED, OUTPUTS
from .propagation import First, Passing
from .setting import Certified, Setting, Since
from .subject import Subject
from .together import Together, propagated

_FILTERS = (minimum_filter1d, maximum_filter1d)

SPARE = 0.002
"""Relative deviation of each entry of K from the line between two evaluated samples."""

ABOVE = 1.05
"""Factor by which each round enlarges its result, so that the next may confirm it."""


class Coupled(Setting):
    """Error bounds of a part of a set for given disturbance bounds, reusable across fixed-point iterations.

    - `demand`: of the whole set.
    - `part`: the members.
    - `chance`: probability that normal noise exceeds its bound at some sample of the run.
    - `width`: decisions that share one response.
    """

    def __init__(self, subject: Subject, demand: Demand, since: Since, part: Part, chance: float, width: int) -> None:
        super().__init__(subject, demand, since)
        self.width = width
        # Effects of uncertain values stay signals, each with its part of the set.
        self.demand = self.requested
        ideal = since.ideal
        nothing = np.zeros_like(demand.push[0])
        self.shared = nothing if ideal.push is None else ideal.push
        self.rest = nothing if ideal.rest is None else ideal.rest
        self.part, loops = part, subject.loops
        n, late = self.samples, self.late
        # Of each period of the arm.
        low, high = np.minimum(part.low[:-1], part.low[1:]), np.maximum(part.high[:-1], part.high[1:])
        self.along = Along(loops, 0.5 * (low + high))
        self.forgetting = forgetting(self.along, n)
        self.confirmed = False
        self.together: Together | None = None
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
        self.together = Together(kernels, width, size, off, under_way)
        self.slope = np.max([part.slope[late + k : late + k + n] for k in range(len(ends) + 1)], axis=0)
        self.assumed, self.tube = np.zeros((3, n, len(loops))), np.zeros_like(part.push[0])

    @property
    def stable(self) -> bool:
        """True if the coupled loop is stable along the motion."""
        return self.together is not None

    def certified(self, more: Floats | None = None, misread: Floats | None = None) -> Certified:
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
        passing = Passing(*(jnp.asarray(values) for values in (*inputs, *reached)))
        acceleration, aims, changes = self.assumed
        tube = np.maximum(
            self.tube[self.late : self.late + len(stray)], self.tube[self.late + 1 : self.late + 1 + len(stray)]
        )
        around = self.together.off + np.einsum("kijl,kl->kij", self.slope, tube)
        together = replace(self.together, off=around)
        before = together.before(acceleration, stray, aims, changes, self.subject.dead_time % 1.0)
        bounds, *came = propagated(self.course, together, passing, self.first, before)
        error, share = self.error_of(bounds)
        middle = np.sqrt(np.prod(self.demand.kappa, axis=0))[:, None]
        joints = len(middle)
        noise = self.noise_size[:, ERROR * joints : (ERROR + 1) * joints].max(axis=0)
        certified = Certified(self.subject, self.narrowing, bounds, error, share, middle, np.zeros_like(middle), noise)
        radius = self.reach(certified)[0]
        self.confirmed = bool((np.array(came) <= self.assumed).all() and (radius <= self.tube).all())
        self.assumed = np.maximum(self.assumed, ABOVE * np.array(came))
        self.tube = np.maximum(self.tube, ABOVE * radius)
        return certified

    def _know(self, chance: float) -> CoupledKernels:
        """Compute the known responses of the loops, and bounds at the first sample."""
        assert self.since is not None
        assert self.forgetting.memory is not None
        n, h, loops, memory = self.samples, self.period, self.subject.loops, self.forgetting.memory
        joints, part = len(loops), self.subject.dead_time % 1.0
        slope = self.course.slopes.between(*(jnp.asarray(self.since.ideal.eps[0]),) * 2)[0]
        follows = self.narrowing.ahead[0] / (self.narrowing.now[0] + self.horizon * np.asarray(slope))
        pushes = np.concatenate([self.part.push - self.shared, self.part.effects]) * h * h
        decisions = np.arange(0, n, self.width) + self.width // 2
        kernels = CoupledKernels(self.along, len(decisions), memory)
        starts = beginnings(self.along, loops, follows, self.since.states)
        known = CoupledKnown(self.along, decisions, self.width, pushes, starts, memory)
        for back in carried_back(self.along, decisions, memory):
            kernels.take(back)
            known.take(back)
        kernels.finish()
        known.finish(kernels.later)
        sizes, bend = known.told(n, len(self.part.push), self.late, part > 0)
        self.bend = bend / (12.0 if part == 0 else 4.0)
        # Pushes of long ago differ by no more than this from what they are taken as.
        older = 2.0 * (
            np.abs(pushes[: len(self.part.push)]).max()
            + np.abs(pushes[len(self.part.push) :]).sum(axis=0).max(initial=0.0)
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
        self.first = First.of(error, led, np.full_like(led, np.inf), size, follows)
        return kernels

    def _noise(self, kernels: CoupledKernels, times: int, chance: float) -> Floats:
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
