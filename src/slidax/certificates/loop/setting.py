"""The common part of all bounds of a set: the law's envelope, its sliding, its sensors, and the nominal run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import maximum_filter1d

from slidax.transformations.psi import psi

from ..demand import Demand
from ..each import Floats
from .ideal import Ideal
from .narrowing import Narrowing
from .noise import Noise
from .padded import of_rows
from .propagation import Bounds, Course
from .sliding import Sliding
from .slopes import Slopes
from .subject import Subject

SPARE = 8
"""Samples by which compiled arrays may be longer than the run."""


@dataclass(frozen=True)
class Certified:
    """Error bounds of a scenario.

    - `narrowing`: its envelope, when torques start.
    - `bounds`: at these times.
    - `error`: of e itself, below and above zero, in size [N 2 n].
    - `share`: bound of the error over the envelope's side, at each sample of the run [N n]; below 1 it holds.
    - `kappa`, `spread`: κ [n j], and the covered deviation around each [n j].
    - `noise`: the noise's part in the bound of e [n], rad or m.
    """

    subject: Subject
    narrowing: Narrowing
    bounds: Bounds
    error: Floats
    share: Floats
    kappa: Floats
    spread: Floats
    noise: Floats


@dataclass(frozen=True)
class Since:
    """Where the bound begins.

    - `ideal`: the nominal run from there.
    - `states`, `slid`: deviations of other members from it, as in `Entry`.
    """

    ideal: Ideal
    states: Floats
    slid: Floats


class Setting:
    """The part of a bound that does not depend on decoupled or coupled loops.

    - `demand`: of a set of arms along the nominal run, or else along the reference.
    - `since`: the initial set with the nominal run. Without it the bound starts with the scenario's start and
      reference, and s counts as reached.
    """

    def __init__(self, subject: Subject, demand: Demand, since: Since | None = None) -> None:
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
        self.noise = Noise.of(subject.scenario, law.joints)
        self.most = round(subject.scenario.t1 / h) + SPARE
        self.narrowing = Narrowing.of(
            subject.drawn, self.sides, period=h, horizon=self.horizon, times=self.set_in, most=self.most
        )
        self.sliding = Sliding.of(subject, self.ideal, self.set_in, self.most)
        self.course = self._course()

    @property
    def lumped(self) -> Floats:
        """‖M0 w*‖ when each torque starts, the largest of all members [N], N m."""
        first = self.late
        push = self.demand.push[:, first : first + self.samples]
        sizes = np.linalg.norm(np.einsum("kij,mkj->mki", self.sliding.inertia, push), axis=2).max(axis=0)
        if self.requested.effects is not None and self.requested.effects.shape[1]:
            parts = self.requested.effects[:, :, first : first + self.samples]
            each = np.linalg.norm(np.einsum("kij,mekj->meki", self.sliding.inertia, parts), axis=3)
            sizes = sizes + each.sum(axis=1).max(axis=0)
        return sizes

    def reach(self, certified: Certified) -> tuple[Floats, Floats, Floats, Floats]:
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

    def _course(self) -> Course:
        return Course(
            surface=self.subject.surface,
            sides=self.sides,
            slopes=Slopes.of(self.subject.surface, self.sides),
            period=jnp.asarray(self.period),
            horizon=jnp.asarray(self.horizon / self.period),
            part=jnp.asarray(self.subject.law.delay % 1.0),
            layer=jnp.asarray(self.subject.cover()[1], float),
        )

    def error_of(self, bounds: Bounds) -> tuple[Floats, Floats]:
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
        push, first, n = self.demand.push, self.late, self.samples
        stray = np.broadcast_to(self.demand.stray, push.shape[1:]) + (0.0 if more is None else more)
        if self.ideal is None:
            # Between two samples w* is off the line by an eighth of its second difference.
            curved = np.zeros(push.shape[1:])
            if push.shape[1] > 2:
                curved[1:-1] = np.max(np.abs(np.diff(push, 2, axis=1)), axis=0) / 8.0
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
        place, pull = of_rows(_place_and_pull, eps, self.most, self.sides, self.subject.surface)
        planned_target = self.ideal.target
        target = narrowing.now * place + self.horizon * pull if planned_target is None else planned_target[:n]
        turn = np.zeros_like(target)
        turn[1:] = np.abs(np.diff(target, axis=0) - np.diff(narrowing.now, axis=0) * place[:-1])
        return target, eps, turn

    def _share(self, error: Floats, bounds: Bounds) -> Floats:
        """The bound over the envelope's side at each sample of the run, from the first torque on."""
        part = self.subject.dead_time % 1.0
        times = self.set_in
        if part > 0:
            # A sample lies between two settings in; there e is off the line between them by h² ë/8 at most.
            off = bounds.acceleration[:-1, None] / 8.0
            error = np.maximum(error[:-1], error[1:]) + off
            times = self.set_in[:-1] + (1.0 - part) * self.period
        radius = of_rows(_radius, times, self.most, self.subject.drawn.performance, self.e)
        sides = np.stack([-np.asarray(self.sides.lower), np.asarray(self.sides.upper)])
        return np.max(error / (sides[None] * radius[:, None]), axis=1)


@eqx.filter_jit
def _place_and_pull(sides: Any, surface: Any, eps: Any) -> tuple[Any, Any]:
    """ψ and φ at each ε."""
    return jax.vmap(lambda value: (psi(value, sides), surface.pull_and_slope(value)[0]))(eps)


@eqx.filter_jit
def _radius(performance: Any, like: Any, times: Any) -> Any:
    return jax.vmap(lambda t: jnp.broadcast_to(performance.radius(t), like.shape))(times)
