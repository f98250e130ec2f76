"""The run of the middle one of a set's arms, beside which the others are followed where many joints are one loop."""

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
from .entered import Entry, Seen, Watching
from .ideal import Ideal
from .remedies import altered
from .subject import Subject

Floats = NDArray[np.floating[Any]]

SILENT = {"sensor.resolution": 0.0, "sensor.position_noise": 0.0, "sensor.velocity_noise": 0.0}

SPARE = 4
"""Samples that it is run longer, so that the last torque sets in."""


@dataclass(frozen=True, eq=False)
class Middle:
    """A run with sensors that neither round nor make noise, of the arm in the middle of a set.

    - `subject`: the law on its task.
    - `plant`: the arm.
    - `seen`, `run`: what it does.
    """

    subject: Subject
    plant: Plant
    seen: Seen
    run: Run

    @classmethod
    def of(cls, subject: Subject) -> Middle | None:
        """None if it leaves its envelope.

        - `subject`: the law on its task.
        """
        members = Members.of(subject.scenario)
        space, axes = members.family.space, len(members.axes)
        values = {
            **space.values(np.full((1, space.dimensions), 0.5)),
            **members.values(np.full((1, axes), 0.5)),
        }
        scenario = members.family.scenario({path: one[0] for path, one in values.items()}, "middle")
        longer = scenario.t1 + (int(np.ceil(subject.dead_time)) + SPARE) * scenario.period
        law = scenario.controller
        assert isinstance(law, SampledData)
        run = _silent(scenario).replace(controller=Watching(law), t1=longer)
        found = run.simulate(log_every=1, progress=False)
        seen = Seen.of(subject, found, Belief.of(subject.scenario, members.plant))
        (plant,) = members.plants(np.full((1, axes), 0.5))
        return None if seen is None else cls(subject, plant, seen, found)

    def ideal(self, entry: Entry) -> Ideal:
        """This run from an entry on.

        - `entry`: where it begins.
        """
        subject, seen = self.subject, self.seen
        h, dead = subject.scenario.period, subject.dead_time
        whole, part = int(dead), dead % 1.0
        total = max(round(subject.scenario.t1 / h), entry.sample + 4)
        decided = np.arange(entry.sample, total)
        set_in = (decided + dead) * h
        samples = np.arange(entry.sample - subject.quiet, round(set_in[-1] / h - 1e-9) + 1)
        q, dq = seen.q[samples], seen.dq[samples]
        wanted = dq - seen.v[samples] / h
        motion = Motion(samples[:-1] * h, q[:-1], dq[:-1], np.diff(dq, axis=0) / h, wanted[:-1])
        at = decided + whole
        error = seen.e[at] + part * (seen.v[at] + 0.5 * part * (seen.v[at + 1] - seen.v[at]))
        assert self.run.log is not None
        said = {name: np.asarray(self.run.log.signals[name])[decided] for name in ("s", "s_next", "eps1", "u")}
        push = self._asked(motion)
        return Ideal(
            motion=motion,
            error=error,
            target=None,
            eps=said["eps1"],
            sliding=said["s"],
            s_next=said["s_next"],
            cover=said["u"] if said["u"].ndim == 1 else said["u"][:, 0],
            push=push,
            rest=self._unexplained(motion, samples[:-1], push),
        )

    def _asked(self, motion: Motion) -> Floats:
        """w* of this arm [N n], rad/s² or m/s²."""
        belief = self.seen.belief
        mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
        believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
        lacks = believed - needed([self.plant], motion)[1][0] + outer([self.plant], motion)[0]
        return np.linalg.solve(mass, lacks[..., None])[..., 0]

    def _unexplained(self, motion: Motion, samples: NDArray[np.integer[Any]], push: Floats) -> Floats:
        """`|a - q̈ + w*|` in the mean of each period [N n], rad/s² or m/s²: what holding the torque does."""
        h, dead = self.subject.scenario.period, self.subject.dead_time
        whole, part = int(dead), dead % 1.0
        decided = [np.maximum(samples - whole - k, 0) for k in (0, 1)]
        command = (1.0 - part) * self.seen.command[decided[0]] + part * self.seen.command[decided[1]]
        acceleration = (command + self.seen.wanted[samples]) / h**2
        later = np.concatenate([push[1:], push[-1:]])
        return np.abs(acceleration - motion.ddq + 0.5 * (push + later))


def _silent(scenario: Scenario) -> Scenario:
    """The same with sensors that measure exactly; what the law believes of them stays."""
    plant = scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant
    exact = altered(scenario, SILENT)
    if exact is None:
        return scenario
    sensor = (exact.plant.own if isinstance(exact.plant, MujocoPlant) else exact.plant).sensor
    return scenario.replace(plant=replace(plant, sensor=sensor))
