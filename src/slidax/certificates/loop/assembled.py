"""From a scenario and what a set of arms asks of it to the bounds of its errors along time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.transformations import Sides

from ..demand import Demand
from .cells import cells_of
from .kernels import ACCELERATION, ERROR, LED, OUTPUTS, Kernels
from .narrowing import Narrowing
from .noise import Noise
from .propagation import Bounds, Course, Passing, propagated
from .pulls import table_of
from .rule import aimed
from .signals import followed
from .subject import Subject

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Certified:
    """The bounds of a scenario's errors.

    - `subject`: whose.
    - `narrowing`: its envelope, when torques set in.
    - `bounds`: at these times.
    - `share`: the bound of the error over the envelope's side, at each sample of the run [N n]; below 1 it holds.
    - `kappa`, `spread`: for which κ [n j], and what around each is covered [n j].
    - `noise`: the noise's part in the bound of e [n], rad or m.
    """

    subject: Subject
    narrowing: Narrowing
    bounds: Bounds
    share: Floats
    kappa: Floats
    spread: Floats
    noise: Floats


class Assembly:
    """All of a scenario's bounds but for the envelope, so that they can be found for many final radii."""

    def __init__(self, subject: Subject, demand: Demand, chance: float = 1e-3) -> None:
        self.subject, self.demand = subject, demand.boxed()
        law = subject.law
        assert law.horizon is not None
        h = self.period = float(law.period)
        self.horizon = float(law.horizon)
        self.samples = demand.times.size - int(subject.dead_time) - 2
        self.set_in = (np.arange(self.samples) + subject.dead_time) * h
        self.e, self.de, self.ddq = subject.start()
        self.sides: Any = subject.drawn.init(jnp.zeros(()), jnp.asarray(self.e))
        self.kappa, self.spread = cells_of(demand.kappa)
        self.kernels = Kernels.of(subject.loops, self.kappa)
        if self.kernels is None:
            return
        self.noise = Noise.of(subject.scenario, law.joints)
        times = self.samples * law.joints * OUTPUTS
        self.noise_size = self.noise.size(h, self.kernels.noise, self.kernels.noise_square, times, chance)
        self.noise_start = self.noise.start(h, times, chance)
        self.heavy = subject.heavy(self.set_in)
        self._known: tuple[Floats, Floats] | None = None

    @property
    def stable(self) -> bool:
        """Whether all loops forget."""
        return self.kernels is not None

    @property
    def signed_error(self) -> Floats:
        """What an acceleration that is constant over a period does to e, by the lag, for the middle κ [n L]."""
        assert self.kernels is not None
        length = self.kernels.of_push.shape[-1]
        found = []
        for loop, row in zip(self.subject.loops, self.kappa, strict=True):
            maps = loop.maps(float(row[row.size // 2]))
            state = maps.enters[:, 3] + maps.enters[:, 4]
            errors = []
            for _ in range(length):
                errors.append(maps.asked[0] @ state)
                state = maps.step @ state
            found.append(errors)
        return np.array(found)

    def certified(self, final: Floats | None = None) -> Certified:
        """The bounds.

        - `final`: another ρ∞ of the envelope [n], rad or m.
        """
        assert self.kernels is not None
        drawn = self.subject.drawn
        if final is not None:
            drawn = replace(drawn, performance=replace(drawn.performance, final=jnp.asarray(final)))
        narrowing = Narrowing.of(drawn, self.sides, period=self.period, horizon=self.horizon, times=self.set_in)
        first, aims = self._first(narrowing)
        bounds = propagated(self._course(), self._passing(narrowing, *self._known_of(aims)), self.e, first)
        share = self._share(bounds, drawn)
        return Certified(
            self.subject, narrowing, bounds, share, self.kappa, self.spread, np.max(self.noise_size[ERROR], axis=1)
        )

    def _first(self, narrowing: Narrowing) -> tuple[tuple[Floats, Floats], Floats]:
        """Bounds of p's spread and of p - ŷ at the first sample, and the p that is held in what is known."""
        y = self.e + narrowing.lead * self.de
        noise = np.max(self.noise_size[LED], axis=1) + self.noise_start[0] + narrowing.lead * self.noise_start[1]
        now, ahead = narrowing.now[0], narrowing.ahead[0]
        sides = Sides(jnp.asarray(narrowing.lower), jnp.asarray(narrowing.upper))
        both = jnp.stack([jnp.maximum(-jnp.asarray(y), 0.0), jnp.maximum(jnp.asarray(y), 0.0)])
        surface, horizon = self.subject.surface, jnp.asarray(self.horizon)
        place = aimed(surface, sides, jnp.asarray(now), horizon, both, jnp.zeros_like(both))[1]
        aims = ahead * np.asarray(place[1] - place[0])
        spread = ahead / now * (noise + self.horizon * self.subject.cover()[1])
        spread = np.minimum(spread, ahead * (narrowing.upper - narrowing.lower))
        return (spread, np.abs(aims - y) + spread + noise), aims

    def _known_of(self, aims: Floats) -> tuple[Floats, Floats, Floats]:
        """What the loops do with what is known, without p and with the first held [N 2 7 n j], and how e bends [N n j].

        Below and above zero, in size.
        """
        if self._known is None:
            self._known = self._pushed()
        free, bend = self._known
        alone = np.empty((self.samples, OUTPUTS, *self.kappa.shape))
        nothing = np.zeros((1, 2))
        for i, loop in enumerate(self.subject.loops):
            still = np.zeros_like(self._begun(i))
            for j, kappa in enumerate(self.kappa[i]):
                found = followed(loop, kappa, nothing, aims[i], still, self.samples, self.subject.quiet)
                alone[:, :, i, j] = found.outputs[:, 0].T
        return free, free + alone[:, None] * np.array([-1.0, 1.0])[:, None, None, None], bend

    def _pushed(self) -> tuple[Floats, Floats]:
        """The loops from their start under the pushes, with noise."""
        h, (n, cells) = self.period, self.kappa.shape
        known = np.empty((self.samples, 2, OUTPUTS, n, cells))
        bend = np.empty((self.samples, n, cells))
        curve = 12.0 if self.subject.dead_time % 1.0 == 0 else 4.0
        for i, loop in enumerate(self.subject.loops):
            push, begun = self.demand.push[:, :, i] * h * h, self._begun(i)
            for j, kappa in enumerate(self.kappa[i]):
                found = followed(loop, kappa, push, 0.0, begun, self.samples, self.subject.quiet)
                extra = self.noise_size[:, i, j, None] + self._first_noise(i, kappa)
                outputs = found.outputs.copy()
                outputs[ACCELERATION] += kappa * found.least
                known[:, 0, :, i, j] = (np.max(-outputs, axis=1) + extra).T
                outputs[ACCELERATION] += kappa * (found.most - found.least)
                known[:, 1, :, i, j] = (np.max(outputs, axis=1) + extra).T
                bend[:, i, j] = kappa * np.max(found.change, axis=0) / curve
        return known, bend

    def _first_noise(self, joint: int, kappa: float) -> Floats:
        """What the noise of the first measurement does, since it is the first prediction as well [7 N]."""
        loop, queue, found = self.subject.loops[joint], self._queue(joint), np.zeros((OUTPUTS, self.samples))
        for k, size in enumerate(self.noise_start):
            if size[joint]:
                state = np.zeros_like(self._begun(joint))
                state[2 + queue + k] = size[joint]
                found += np.abs(followed(loop, kappa, np.zeros((1, 2)), 0.0, state, self.samples).outputs[:, 0])
        return found

    def _queue(self, joint: int) -> int:
        return int(max(1, np.ceil(self.subject.loops[joint].believed)))

    def _begun(self, joint: int) -> Floats:
        """The loop's state at its first measurement, `quiet` periods before the start."""
        queue, quiet, h = self._queue(joint), self.subject.quiet, self.period
        state = np.zeros(2 + queue + 6)
        speed = self.de[joint] * h
        state[0], state[1] = self.e[joint] - quiet * speed, speed
        # The arm is held until the first command sets in: behind a reference that accelerates.
        acts = np.arange(queue, 0, -1) - 1
        held = int(self.subject.dead_time) - 1 - acts[::-1] >= 0
        state[2 : 2 + queue] = np.where(held, -self.ddq[joint] * h * h, 0.0)
        state[2 + queue], state[3 + queue] = state[0], state[1]
        state[-2:] = state[:2] if self._remembers(joint) else 0.0
        return state

    def _remembers(self, joint: int) -> bool:
        loop = self.subject.loops[joint]
        return loop.measures_velocity and loop.follows is not None

    def _course(self) -> Course:
        found = self.kernels
        assert found is not None
        tails = (found.push_tail, found.place_tail, found.change_tail)
        return Course(
            table=tuple(jnp.asarray(one) for one in table_of(self.subject.surface, self.sides)),
            period=jnp.asarray(self.period),
            horizon=jnp.asarray(self.horizon / self.period),
            part=jnp.asarray(self.subject.law.delay % 1.0),
            of_push=jnp.asarray(found.of_push[..., ::-1]),
            of_place=jnp.asarray(found.of_place[..., ::-1]),
            of_change=jnp.asarray(found.of_change[..., ::-1]),
            tails=tuple(jnp.asarray(one) for one in tails),
            fading=jnp.asarray(found.fading),
            spread=jnp.asarray(self.spread),
            kappa=jnp.asarray(self.kappa),
            coupling=jnp.asarray(self.demand.coupling),
            layer=jnp.asarray(self.subject.cover()[1], float),
        )

    def _passing(self, narrowing: Narrowing, free: Floats, held: Floats, bend: Floats) -> Passing:
        push, first = self.demand.push, int(self.subject.dead_time)
        # Between two samples w* is off the line by an eighth of its second difference.
        curved = np.zeros(push.shape[1:])
        if push.shape[1] > 2:
            curved[1:-1] = np.max(np.abs(np.diff(push, 2, axis=1)), axis=0) / 8.0
            curved[:-1] = np.maximum(curved[:-1], curved[1:])
        stray = (np.broadcast_to(self.demand.stray, curved.shape) + curved) * self.period**2
        later = np.concatenate([stray, np.repeat(stray[-1:], 3, axis=0)])
        stray = np.max([later[first + k : first + k + self.samples] for k in range(3)], axis=0)
        given = (narrowing.now, narrowing.ahead, free, held, stray, bend, self.heavy)
        return Passing(*(jnp.asarray(one) for one in given))

    def _share(self, bounds: Bounds, drawn: Any) -> Floats:
        """The bound over the envelope's side at each sample of the run, from when the first torque sets in."""
        part = self.subject.dead_time % 1.0
        error = bounds.error
        times = self.set_in
        if part > 0:
            # A sample lies between two settings in; there e is off the line between them by h² ë/8 at most.
            off = bounds.acceleration[:-1, None] / 8.0
            error = np.maximum(error[:-1], error[1:]) + off
            times = (np.arange(error.shape[0]) + np.ceil(self.subject.dead_time)) * self.period
        radius = np.asarray(jax.vmap(lambda t: jnp.broadcast_to(drawn.performance.radius(t), self.e.shape))(times))
        sides = np.stack([-np.asarray(self.sides.lower), np.asarray(self.sides.upper)])
        found: Floats = np.max(error / (sides[None] * radius[:, None]), axis=1)
        return found
