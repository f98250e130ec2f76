"""From when on the arms of a set follow their plans, and how far from each other they then are: seen in cases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.controllers import AbstractController, SampledData
from slidax.simulation import Plant, Run
from slidax.studies.cases import Cases

from ..arm.learnt import learns
from ..arm.members import Members
from ..arm.motion import Belief
from .subject import Subject

Floats = NDArray[np.floating[Any]]

CASES = 16
"""Of the set, the first of them its middle."""


LATEST = 0.75
"""Share of the run by which s must be reached."""


class Watching(AbstractController):
    """A law that also says what it keeps for its next sample; it decides nothing else."""

    law: SampledData

    @property
    def joints(self) -> int:
        """Those of the law."""
        return self.law.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """As the law."""
        return self.law.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """As the law, with more signals."""
        command = self.law(t, state, reference_now, reference_next, memory)
        kept = command.memory
        rate = kept.estimator if isinstance(kept.estimator, jnp.ndarray) else jnp.zeros_like(state.q)
        said = {
            "prior_q": kept.prior.state.q,
            "prior_dq": kept.prior.state.dq,
            "prior_push": kept.prior.push,
            "push_rate": rate,
            "measured_q": state.q,
            "measured_dq": state.dq,
            "kept_s": kept.step.s,
            "free": kept.planned.astype(float),
        }
        return Command(tau=command.tau, memory=kept, signals={**command.signals, **said})

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """As the law."""
        return self.law.envelope(t, memory)


@dataclass(frozen=True, eq=False)
class Entry:
    """Where the set's arms are when from now on each keeps s and its limits.

    - `sample`: k0, the first decision that is counted.
    - `cases`: how many were looked at; `margin`: the least of them up to there, of the envelope's width.
    - `q`, `dq`: of the middle one, from the sample that this decision is made from to when its torque sets in [m n].
    - `commands`: its relative accelerations in the periods whose torques are under way, the newest first [Q n].
    - `s`: what it remembers of s [n]; `slid`: by how much others differ from that [n], rad/s or m/s.
    - `seen`: for a law that learns, the arms, each with what it came to believe of it.
    - `states`: by how much each differs from it in e, ė, what each command under way is planned to do, and in what is
      wrong of the prediction of e and ė, of ŵ, its rate and the last measurement [cases 8 + Q n]; units of periods.
    """

    sample: int
    cases: int
    margin: float
    q: Floats
    dq: Floats
    s: Floats
    slid: Floats
    states: Floats
    seen: list[tuple[Plant, Belief]]


@dataclass(frozen=True, eq=False)
class Approach:
    """Cases of a set, the first of them its middle.

    - `subject`: the law on its task.
    - `seen`: the runs, `plants` their arms.
    - `late`: the first sample from which on all of them keep s and their limits.
    """

    subject: Subject
    seen: list[Seen]
    plants: list[Plant]
    late: int

    @property
    def samples(self) -> int:
        """Of a run."""
        return int(self.seen[0].e.shape[0])

    def entry(self, sample: int, beside: Seen | None = None) -> Entry:
        """Where they are at a sample.

        - `sample`: not before `late`.
        - `beside`: the run that they are followed beside; what the middle one's law plans if None.
        """
        subject, middle = self.subject, self.seen[0] if beside is None else beside
        states = np.array([one.state(sample, middle) for one in self.seen])
        if beside is not None:
            states = states - beside.state(sample, beside)
        ends = slice(sample - subject.quiet, sample + int(np.ceil(subject.dead_time)) + 2)
        kept = np.array([one.s[sample] for one in self.seen])
        s = middle.s[sample]
        learning = learns(subject.scenario)
        return Entry(
            sample=sample,
            cases=len(self.seen),
            margin=min(one.margin(sample) for one in self.seen),
            q=middle.q[ends],
            dq=middle.dq[ends],
            s=s,
            slid=np.max(np.abs(kept - s), axis=0),
            states=states,
            seen=[(arm, one.belief) for arm, one in zip(self.plants, self.seen, strict=True)] if learning else [],
        )


def approached(subject: Subject, cases: int = CASES, seed: int = 0) -> Approach | str:
    """Cases of a scenario's set on their way to where their bounds can begin, or why there are none.

    - `subject`: the law on its task.
    - `cases`: how many are run.
    - `seed`: of all but the first.
    """
    scenario = subject.scenario
    members = Members.of(scenario)
    family = members.family
    width = family.space.dimensions
    rows = cases if width else 1
    corners = np.full((rows, len(members.axes)), 0.5)
    corners[1:] = members.extremes(rows - 1)
    values = {**family.space.values(_shares(family.space.coordinates, seed, rows)), **members.values(corners)}
    runs = Cases(family, around=Watching).logged(values)
    believed = Belief.of(scenario, members.plant)
    seen = [Seen.of(subject, run, believed) for run in runs]
    lost = [one for one in seen if one is None]
    if lost:
        return f"{len(lost)} of {len(seen)} cases of the set leave their envelope"
    good = [one for one in seen if one is not None]
    queue = max(1, int(np.ceil(subject.law.delay)))
    late = max(max(one.late for one in good) + queue + 3, subject.quiet + queue + 3)
    if late > LATEST * good[0].e.shape[0]:
        since = late * scenario.period
        return f"s is reached, or a limit of the drives, as late as t = {since:.3g} s in cases of the set"
    return Approach(subject, good, members.plants(corners), late)


def _shares(names: Sequence[str], seed: int, rows: int) -> Floats:
    """Points of a cube: its middle, and by turns a corner and any; each coordinate's own, whatever others there are."""
    found = np.full((rows, len(names)), 0.5)
    for k, name in enumerate(names):
        found[:, k] = np.random.default_rng([seed, crc32(name.encode())]).uniform(0.0, 1.0, rows)
    # Corners differ most.
    found[1::2] = np.where(found[1::2] < 0.5, 0.0, np.nextafter(1.0, 0.0))
    found[0] = 0.5
    return found


@dataclass(frozen=True, eq=False)
class Seen:
    """A run, relative to its reference and in units of periods."""

    subject: Subject
    late: int
    q: Floats
    dq: Floats
    e: Floats
    v: Floats
    wanted: Floats
    command: Floats
    prior: tuple[Floats, Floats]
    last: tuple[Floats, Floats]
    push: Floats
    rate: Floats
    s: Floats
    room: Floats
    belief: Belief

    @classmethod
    def of(cls, subject: Subject, run: Run, first: Belief) -> Seen | None:
        """None if it left its envelope; `first` is what the law believes of its arm before it learns."""
        log, h = run.log, subject.scenario.period
        assert log is not None
        assert log.envelope is not None
        valid = np.asarray(log.valid)
        e, v = np.asarray(log.e), np.asarray(log.de) * h
        lower, upper = np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
        room = np.min(np.minimum(e - lower, upper - e) / (upper - lower), axis=1)
        if not valid.all() or room.min() <= 0.0:
            return None
        said = {name: np.asarray(one) for name, one in log.signals.items()}
        q, dq = np.asarray(log.state.q), np.asarray(log.state.dq)
        want_q, want_v = q - e, dq - v / h
        layer = subject.cover()[1]
        bad = (said["free"] < 0.5) | np.any(np.abs(said["s_next"]) > max(layer, 1e-12), axis=1)
        bad[-1] = False
        n = len(e)
        dead = int(subject.dead_time)
        at = np.minimum(np.arange(n) + dead, n - 1)
        mean = np.diff(want_v, axis=0, append=want_v[-1:]) * h
        t = np.asarray(log.t)
        belief = _believed(first, said, t + subject.dead_time * h)
        mass, bias = belief.mass_and_bias(t[at], q[at], dq[at])
        bias = bias + belief.friction(t[at], want_v[at])
        command = np.linalg.solve(mass, (np.asarray(log.tau) - bias)[..., None])[..., 0] * h * h
        # What is predicted at a sample is of the one `quiet` before the next.
        then = np.clip(np.arange(n) + 1 - subject.quiet, 0, n - 1)
        measured = np.clip(np.arange(n) - subject.quiet, 0, n - 1)
        return cls(
            subject=subject,
            late=int(np.flatnonzero(bad)[-1]) if bad.any() else 0,
            q=q,
            dq=dq,
            e=e,
            v=v,
            wanted=mean,
            command=command - mean[at],
            prior=(said["prior_q"] - want_q[then], said["prior_dq"] * h - want_v[then] * h),
            last=(said["measured_q"] - want_q[measured], (said["measured_dq"] - want_v[measured]) * h),
            push=said["prior_push"] * h * h,
            rate=said["push_rate"] * h**3,
            s=said["kept_s"],
            room=room,
            belief=belief,
        )

    def margin(self, until: int) -> float:
        """The least room up to a sample."""
        return float(self.room[: until + 1].min())

    def state(self, first: int, middle: Seen) -> Floats:
        """What is known of it at a decision beside the middle one [8 + Q, n]; the middle one does what it did."""
        subject = self.subject
        m, queue = first - subject.quiet, max(1, int(np.ceil(subject.law.delay)))
        dead, before = int(subject.dead_time), first - 1
        rows = [self.e[m] - middle.e[m], self.v[m] - middle.v[m]]
        for i in range(queue):
            sets_in = before - i + dead
            moved = middle.v[sets_in + 1] - middle.v[sets_in]
            rows.append(self.command[before - i] + self.push[before] - moved)
        rows += [self.prior[0][before] - self.e[m], self.prior[1][before] - self.v[m]]
        # In the last whole period: what the arm did beyond the command that acted.
        acted = m - 1 - dead
        unexplained = (self.v[m] - self.v[m - 1]) - self.command[acted]
        rows += [self.push[before] - unexplained, self.rate[before]]
        loop = subject.loops[0]
        if loop.measures_velocity and loop.follows is not None:
            rows += [self.last[0][before] - self.e[m - 1], self.last[1][before] - self.v[m - 1]]
        else:
            rows += [np.zeros_like(rows[0]), np.zeros_like(rows[0])]
        return np.array(rows)


def _believed(first: Belief, said: dict[str, Floats], times: Floats) -> Belief:
    """What the law believed of its arm at each time."""
    if first.rotor is None:
        return first
    return replace(first, rotor=said["rotor"], coulomb=said["coulomb"], times=times)
