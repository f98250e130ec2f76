"""Initial set: when members start tracking, and their spread, estimated from 16 runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import jax.numpy as jnp
import numpy as np

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.controllers import AbstractController, SampledData
from slidax.simulation import Plant, Run
from slidax.studies.cases import Cases

from ..arm.learnt import learns
from ..arm.members import Members
from ..arm.motion import Belief
from ..each import Floats
from .subject import Subject

CASES = 16
"""Number of cases of the set; the first is its middle."""


LATEST = 0.75
"""Share of the run by which s must be reached."""


class Watching(AbstractController):
    """A law that also logs its memory for the next sample; it decides the same."""

    law: SampledData

    @property
    def joints(self) -> int:
        return self.law.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        return self.law.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The law's command, with more signals."""
        command = self.law(t, state, reference_now, reference_next, memory)
        kept = command.memory
        rate = kept.estimator if isinstance(kept.estimator, jnp.ndarray) else jnp.zeros_like(state.q)
        signals = {
            "prior_q": kept.prior.state.q,
            "prior_dq": kept.prior.state.dq,
            "prior_push": kept.prior.push,
            "push_rate": rate,
            "measured_q": state.q,
            "measured_dq": state.dq,
            "kept_s": kept.step.s,
            "free": kept.planned.astype(float),
        }
        return Command(tau=command.tau, memory=kept, signals={**command.signals, **signals})

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)


@dataclass(frozen=True, eq=False)
class Entry:
    """States of the set's members from which on each keeps s and its limits.

    - `sample`: k0, the first decision that counts.
    - `cases`: number of simulated cases; `margin`: their least margin up to there, of the envelope's width.
    - `q`, `dq`: of the nominal member, from the sample of this decision to the start of its torque [m n].
    - `s`: in its memory [n]; `slid`: deviation of other members from it [n], rad/s or m/s.
    - `states`: deviation of each member from the nominal one in e, ė, the planned effect of each pending command, the
      prediction errors of e and ė, ŵ, its rate and the last measurement [cases 8 + Q n]; units of periods.
    - `arms`: for a law that learns, the arms, each with its learned model.
    """

    sample: int
    cases: int
    margin: float
    q: Floats
    dq: Floats
    s: Floats
    slid: Floats
    states: Floats
    arms: list[tuple[Plant, Belief]]


@dataclass(frozen=True, eq=False)
class Approach:
    """Simulated cases of a set, the first of them its middle.

    - `traces`: the runs, `plants` their arms.
    - `late`: the first sample from which on all of them keep s and their limits.
    """

    subject: Subject
    traces: list[Seen]
    plants: list[Plant]
    late: int

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return int(self.traces[0].e.shape[0])

    def entry(self, sample: int, nominal: Seen | None = None) -> Entry:
        """The initial set at a sample.

        - `sample`: not before `late`.
        - `nominal`: the run from which deviations count; by default that planned by the nominal member's law.
        """
        subject, middle = self.subject, self.traces[0] if nominal is None else nominal
        states = np.array([trace.state(sample, middle) for trace in self.traces])
        if nominal is not None:
            states = states - nominal.state(sample, nominal)
        ends = slice(sample - subject.quiet, sample + int(np.ceil(subject.dead_time)) + 2)
        kept = np.array([trace.s[sample] for trace in self.traces])
        s = middle.s[sample]
        learning = learns(subject.scenario)
        return Entry(
            sample=sample,
            cases=len(self.traces),
            margin=min(trace.margin(sample) for trace in self.traces),
            q=middle.q[ends],
            dq=middle.dq[ends],
            s=s,
            slid=np.max(np.abs(kept - s), axis=0),
            states=states,
            arms=[(arm, trace.belief) for arm, trace in zip(self.plants, self.traces, strict=True)] if learning else [],
        )


def approached(subject: Subject, cases: int = CASES, seed: int = 0) -> Approach | str:
    """Simulate cases of a scenario's set until their bounds can begin; or return the reason why they cannot.

    - `seed`: of all cases but the first.
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
    traces = [Seen.of(subject, run, believed) for run in runs]
    lost = [trace for trace in traces if trace is None]
    if lost:
        return f"{len(lost)} of {len(traces)} cases of the set leave their envelope"
    good = [trace for trace in traces if trace is not None]
    queue = max(1, int(np.ceil(subject.law.delay)))
    late = max(max(trace.late for trace in good) + queue + 3, subject.quiet + queue + 3)
    if late > LATEST * good[0].e.shape[0]:
        since = late * scenario.period
        return f"s is reached, or a limit of the drives, as late as t = {since:.3g} s in cases of the set"
    return Approach(subject, good, members.plants(corners), late)


def _shares(names: Sequence[str], seed: int, rows: int) -> Floats:
    """Points of a cube: its middle, and alternating corners and inner points, drawn for each coordinate by its name."""
    shares = np.full((rows, len(names)), 0.5)
    for k, name in enumerate(names):
        shares[:, k] = np.random.default_rng([seed, crc32(name.encode())]).uniform(0.0, 1.0, rows)
    # Corners differ most.
    shares[1::2] = np.where(shares[1::2] < 0.5, 0.0, np.nextafter(1.0, 0.0))
    shares[0] = 0.5
    return shares


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
        """The trace of a run; None if it left its envelope. `first` is the law's initial model."""
        log, h = run.log, subject.scenario.period
        assert log is not None
        assert log.envelope is not None
        valid = np.asarray(log.valid)
        e, v = np.asarray(log.e), np.asarray(log.de) * h
        lower, upper = np.asarray(log.envelope.lower), np.asarray(log.envelope.upper)
        room = np.min(np.minimum(e - lower, upper - e) / (upper - lower), axis=1)
        if not valid.all() or room.min() <= 0.0:
            return None
        signals = {name: np.asarray(signal) for name, signal in log.signals.items()}
        q, dq = np.asarray(log.state.q), np.asarray(log.state.dq)
        want_q, want_v = q - e, dq - v / h
        layer = subject.cover()[1]
        bad = (signals["free"] < 0.5) | np.any(np.abs(signals["s_next"]) > max(layer, 1e-12), axis=1)
        bad[-1] = False
        n = len(e)
        dead = int(subject.dead_time)
        at = np.minimum(np.arange(n) + dead, n - 1)
        mean = np.diff(want_v, axis=0, append=want_v[-1:]) * h
        t = np.asarray(log.t)
        belief = _believed(first, signals, t + subject.dead_time * h)
        mass, bias = belief.mass_and_bias(t[at], q[at], dq[at])
        bias = bias + belief.friction(t[at], want_v[at])
        command = np.linalg.solve(mass, (np.asarray(log.tau) - bias)[..., None])[..., 0] * h * h
        # The prediction at a sample is for the sample `quiet` before the next.
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
            prior=(signals["prior_q"] - want_q[then], signals["prior_dq"] * h - want_v[then] * h),
            last=(signals["measured_q"] - want_q[measured], (signals["measured_dq"] - want_v[measured]) * h),
            push=signals["prior_push"] * h * h,
            rate=signals["push_rate"] * h**3,
            s=signals["kept_s"],
            room=room,
            belief=belief,
        )

    def margin(self, until: int) -> float:
        """The least margin up to a sample."""
        return float(self.room[: until + 1].min())

    def state(self, first: int, middle: Seen) -> Floats:
        """Deviation from the nominal run at a decision [8 + Q, n]."""
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


def _believed(first: Belief, signals: dict[str, Floats], times: Floats) -> Belief:
    """The law's learned model at each time."""
    if first.rotor is None:
        return first
    return replace(first, rotor=signals["rotor"], coulomb=signals["coulomb"], times=times)
