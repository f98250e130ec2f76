"""Nominal run, from which deviations of all other members are bounded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.controllers import SampledData
from slidax.scenarios import Scenario
from slidax.simulation import MujocoPlant, Plant, Run

from ..arm.members import Members
from ..arm.motion import Belief, Motion, needed, outer
from ..each import Floats
from .entered import Entry, Seen, Watching
from .ideal import Ideal
from .remedies import altered
from .subject import Subject

SILENT = {"sensor.resolution": 0.0, "sensor.position_noise": 0.0, "sensor.velocity_noise": 0.0}

SPARE = 4
"""Additional samples, so that the last torque starts."""


@dataclass(frozen=True, eq=False)
class Middle:
    """A run of the arm in the middle of a set, with sensors without rounding or noise."""

    subject: Subject
    plant: Plant
    trace: Seen
    run: Run

    @classmethod
    def of(cls, subject: Subject) -> Middle | None:
        """The run; None if it leaves its envelope."""
        members = Members.of(subject.scenario)
        space, axes = members.family.space, len(members.axes)
        values = {
            **space.values(np.full((1, space.dimensions), 0.5)),
            **members.values(np.full((1, axes), 0.5)),
        }
        scenario = members.family.scenario({path: value[0] for path, value in values.items()}, "middle")
        longer = scenario.t1 + (int(np.ceil(subject.dead_time)) + SPARE) * scenario.period
        law = scenario.controller
        assert isinstance(law, SampledData)
        run = _silent(scenario).replace(controller=Watching(law), t1=longer)
        result = run.simulate(log_every=1, progress=False)
        trace = Seen.of(subject, result, Belief.of(subject.scenario, members.plant))
        (plant,) = members.plants(np.full((1, axes), 0.5))
        return None if trace is None else cls(subject, plant, trace, result)

    def ideal(self, entry: Entry) -> Ideal:
        """This run from an initial set on."""
        subject, trace = self.subject, self.trace
        h, dead = subject.scenario.period, subject.dead_time
        whole, part = int(dead), dead % 1.0
        total = max(round(subject.scenario.t1 / h), entry.sample + 4)
        decided = np.arange(entry.sample, total)
        set_in = (decided + dead) * h
        samples = np.arange(entry.sample - subject.quiet, round(set_in[-1] / h - 1e-9) + 1)
        q, dq = trace.q[samples], trace.dq[samples]
        wanted = dq - trace.v[samples] / h
        motion = Motion(samples[:-1] * h, q[:-1], dq[:-1], np.diff(dq, axis=0) / h, wanted[:-1])
        at = decided + whole
        error = trace.e[at] + part * (trace.v[at] + 0.5 * part * (trace.v[at + 1] - trace.v[at]))
        assert self.run.log is not None
        signals = {name: np.asarray(self.run.log.signals[name])[decided] for name in ("s", "s_next", "eps1", "u")}
        push = self._disturbance(motion)
        return Ideal(
            motion=motion,
            error=error,
            target=None,
            eps=signals["eps1"],
            sliding=signals["s"],
            s_next=signals["s_next"],
            cover=signals["u"] if signals["u"].ndim == 1 else signals["u"][:, 0],
            push=push,
            rest=self._unexplained(motion, samples[:-1], push),
        )

    def _disturbance(self, motion: Motion) -> Floats:
        """w* of this arm [N n], rad/s² or m/s²."""
        belief = self.trace.belief
        mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
        believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
        lacks = believed - needed([self.plant], motion)[1][0] + outer([self.plant], motion)[0]
        return np.linalg.solve(mass, lacks[..., None])[..., 0]

    def _unexplained(self, motion: Motion, samples: NDArray[np.integer[Any]], push: Floats) -> Floats:
        """`|a - q̈ + w*|` in the mean of each period [N n], rad/s² or m/s²: the effect of holding the torque."""
        h, dead = self.subject.scenario.period, self.subject.dead_time
        whole, part = int(dead), dead % 1.0
        decided = [np.maximum(samples - whole - k, 0) for k in (0, 1)]
        command = (1.0 - part) * self.trace.command[decided[0]] + part * self.trace.command[decided[1]]
        acceleration = (command + self.trace.wanted[samples]) / h**2
        later = np.concatenate([push[1:], push[-1:]])
        return np.abs(acceleration - motion.ddq + 0.5 * (push + later))


def _silent(scenario: Scenario) -> Scenario:
    """The scenario with exact sensors; the law's parameters for them stay."""
    plant = scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant
    exact = altered(scenario, SILENT)
    if exact is None:
        return scenario
    sensor = (exact.plant.own if isinstance(exact.plant, MujocoPlant) else exact.plant).sensor
    return scenario.replace(plant=replace(plant, sensor=sensor))
