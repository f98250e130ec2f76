"""The bounds of a part of a scenario's set, with the joints' loops as one: the phase between joints is kept."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..arm.part import Part
from ..demand import Demand
from .coupled_kernels import CoupledKernels, length_of
from .coupled_known import begun, pushed
from .coupled_maps import CoupledMaps
from .kernels import ERROR, LED, OUTPUTS
from .propagation import First, Passing
from .setting import Certified, Setting, Since
from .subject import Subject
from .together import Together, propagated

Floats = NDArray[np.floating[Any]]

SEGMENT = 64
"""Decisions for which one K is taken."""

SPARE = 0.002
"""Share of each entry of K by which it may be off the line between two samples at which it is computed."""

ABOVE = 1.05
"""By which each round takes more than it found, so that the next may confirm it."""


class Coupled(Setting):
    """All of the bounds of a part of a set but for what its arms ask for beside their motion.

    - `subject`, `demand`, `since`: as of `Setting`; the demand is that of the whole set.
    - `part`: the members.
    - `chance`: that normal noise is larger than is counted at some sample of the run.
    """

    def __init__(self, subject: Subject, demand: Demand, since: Since, part: Part, chance: float = 1e-3) -> None:
        super().__init__(subject, demand, since)
        # What uncertain numbers add is followed as a signal, with its part of the set.
        self.demand = self.asked
        self.part, loops = part, subject.loops
        n = self.samples
        # A torque sets in at a sample or between two, and lasts for a period.
        ends = [slice(self.late + k, self.late + k + n) for k in range(2 + (subject.dead_time % 1.0 > 0))]
        low: Floats = np.array([part.low[one] for one in ends]).min(axis=0)
        high: Floats = np.array([part.high[one] for one in ends]).max(axis=0)
        edges = (*range(0, n - SEGMENT // 2, SEGMENT), n)
        spans = [range(*one) for one in pairwise(edges)]
        matrices = np.array([0.5 * (low[one].min(axis=0) + high[one].max(axis=0)) for one in spans])
        maps = [CoupledMaps.of(loops, one) for one in matrices]
        self.radius = np.array([one.radius for one in maps])
        self.confirmed = False
        self.together: Together | None = None
        length = length_of(maps)
        if length is None:
            return
        kernels = [CoupledKernels.of(one, loops[0], length) for one in maps]
        wider, queue = SPARE * np.maximum(np.abs(low), np.abs(high)), maps[0].own - 8
        seen = np.abs(since.states).max(axis=0)
        # Of a command under way: what it is planned to do, and what the estimate misses.
        under_way = seen[2 : 2 + queue] + seen[4 + queue]
        self.together = Together(edges, matrices, kernels, low, high, wider, under_way)
        self.slope = np.max([part.slope[one] for one in ends], axis=0)
        self.assumed, self.tube = np.zeros((3, n, len(loops))), np.zeros_like(part.push[0])
        self._know(maps, spans, chance)

    @property
    def stable(self) -> bool:
        """Whether all loops forget, with each K along the motion as if it stayed."""
        return self.together is not None

    def certified(self, more: Floats | None = None, misread: Floats | None = None) -> Certified:
        """The bounds, from what the last ones brought in: true if that is `confirmed`.

        - `more`, `misread`: as of `Assembly.certified`.
        """
        assert self.together is not None
        stray = self.strayed(more)
        free, held = self.free, self.held
        if misread is not None:
            extra = self._misled(misread)[:, None, :, :, None]
            free, held = free + extra, held + extra
        target, eps, turn = self.planned()
        narrowing, sliding = self.narrowing, self.sliding
        given = (narrowing.now, narrowing.ahead, free, held, stray, self.bend[:, :, None], target, eps, turn)
        reached = (sliding.size, sliding.s_next, sliding.root, sliding.mass, sliding.grown)
        passing = Passing(*(jnp.asarray(one) for one in (*given, *reached)))
        acceleration, aims, changes = self.assumed
        tube = np.maximum(
            self.tube[self.late : self.late + len(stray)], self.tube[self.late + 1 : self.late + 1 + len(stray)]
        )
        around = self.together.wider + np.einsum("kijl,kl->kij", self.slope, tube)
        together = replace(self.together, wider=around)
        before = together.before(acceleration, stray, aims, changes, self.subject.dead_time % 1.0)
        bounds, *came = propagated(self.course, together, passing, self.first, before)
        error, share = self.error_of(bounds)
        middle = np.sqrt(np.prod(self.demand.kappa, axis=0))[:, None]
        noise = self.noise_size[:, ERROR].max(axis=0)
        found = Certified(self.subject, self.narrowing, bounds, error, share, middle, np.zeros_like(middle), noise)
        radius = self.reach(found)[0]
        self.confirmed = bool((np.array(came) <= self.assumed).all() and (radius <= self.tube).all())
        self.assumed = np.maximum(self.assumed, ABOVE * np.array(came))
        self.tube = np.maximum(self.tube, ABOVE * radius)
        return found

    def _know(self, maps: list[CoupledMaps], spans: list[range], chance: float) -> None:
        """What is known of the loops beforehand, and bounds at the first sample."""
        assert self.together is not None
        assert self.since is not None
        n, h, loops = self.samples, self.period, self.subject.loops
        joints, kernels = len(loops), self.together.kernels
        times = n * joints * OUTPUTS
        self.noise_size = np.array([self._noise(one, times, chance) for one in kernels])
        slope = self.course.slopes.between(*(jnp.asarray(self.since.ideal.eps[0]),) * 2)[0]
        follows = self.narrowing.ahead[0] / (self.narrowing.now[0] + self.horizon * np.asarray(slope))
        pushes = (self.part.push * h * h, self.part.effects * h * h)
        # Pushes of long ago differ by no more than this from what they are taken as.
        older = 2.0 * (np.abs(pushes[0]).max(axis=(0, 1)) + np.abs(pushes[1]).sum(axis=0).max(axis=0))
        self.free, self.held = np.empty((2, n, 2, OUTPUTS, joints, 1))
        self.bend = np.empty((n, joints))
        curve = 12.0 if self.subject.dead_time % 1.0 == 0 else 4.0
        for i, (one, span) in enumerate(zip(maps, spans, strict=True)):
            sizes, bend = pushed(one, loops[0], self.together.matrices[i], pushes, span, self.together.reach)
            extra = self.noise_size[i] + kernels[i].tails[0] @ (np.abs(self.together.matrices[i]) @ older)
            alone, kept = begun(one, loops, follows, self.since.states, span)
            at = slice(span.start, span.stop)
            for into, whence in ((self.free, alone), (self.held, kept)):
                into[at, ..., 0] = sizes + extra + whence[:, None]
            self.bend[at] = bend / curve
        slid = np.abs(self.since.slid)
        size = float(np.sqrt(slid @ self.sliding.mass[0] @ slid))
        known = self.free[0, :, LED, :, 0].max(axis=0)
        error = self.free[0, :, ERROR, :, 0]
        self.first = First.of(error, known, np.full_like(known, np.inf), size, follows)

    def _noise(self, kernels: CoupledKernels, times: int, chance: float) -> Floats:
        """How much of the sensors' noise arrives at each output [9 n], as `Noise.size` has it for one joint's loop."""
        noise, h = self.noise, self.period
        position, velocity = noise.position_deviation**2, (h * noise.velocity_deviation) ** 2
        spread = np.sqrt(kernels.noise_square[0] @ position + kernels.noise_square[1] @ velocity)
        found: Floats = kernels.noise[0] @ noise.position + noise.deviations(times, chance) * spread
        return found

    def _misled(self, misread: Floats) -> Floats:
        """What commands that are predicted as others do at most [N 9 n]."""
        assert self.together is not None
        length = self.together.reach
        which = np.repeat(np.arange(len(self.together.kernels)), np.diff(self.together.edges))
        of_command = np.array([one.of_command for one in self.together.kernels])
        found: Floats = np.einsum("koij,kj->koi", of_command[which], self.recent(misread, length))
        if self.demand.relearnt is not None:
            of_estimate = np.array([one.of_estimate for one in self.together.kernels])
            found = found + np.einsum("koij,kj->koi", of_estimate[which], self.recent(self.demand.relearnt, length))
        return found
