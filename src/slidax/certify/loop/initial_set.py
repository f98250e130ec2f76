"""Initial set: start of tracking and spread of the members, from simulated cases; the nominal run from there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.law.controllers import AbstractController
from slidax.law.sampled.controller import SampledData
from slidax.law.steps import StepInput
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import MujocoPlant, Plant
from slidax.simulation.run import Run
from slidax.studies.cases import Cases

from ..arm.arm_motion import NominalModel, StateSequence, outer_torque, rigid_body_torque
from ..arm.learned_demand import learns_inertia
from ..arm.members import Members
from ..sampled_scenario import Floats
from .problem import LoopProblem
from .remedies import with_changes

CASES = 16
"""Number of cases of the set; the first is its middle."""


LATEST = 0.75
"""Share of the run by which s must be reached."""


class LoggingLaw(AbstractController):
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
            "prior_disturbance": kept.prior.disturbance,
            "disturbance_rate": rate,
            "measured_q": state.q,
            "measured_dq": state.dq,
            "kept_s": kept.step.s,
            "free": kept.planned.astype(float),
        }
        return Command(tau=command.tau, memory=kept, signals={**command.signals, **signals})

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)


@dataclass(frozen=True, eq=False)
class InitialSet:
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
    arms: list[tuple[Plant, NominalModel]]


@dataclass(frozen=True, eq=False)
class CaseRuns:
    """Simulated cases of a set, the first of them its middle.

    - `traces`: the runs, `plants` their arms.
    - `late`: the first sample from which on all of them keep s and their limits.
    """

    subject: LoopProblem
    traces: list[CaseTrace]
    plants: list[Plant]
    late: int

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return int(self.traces[0].e.shape[0])

    def entry(self, sample: int, nominal: CaseTrace | None = None) -> InitialSet:
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
        learning = learns_inertia(subject.scenario)
        return InitialSet(
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


def simulate_cases(subject: LoopProblem, cases: int = CASES, seed: int = 0) -> CaseRuns | str:
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
    runs = Cases(family, around=LoggingLaw).logged(values)
    believed = NominalModel.of(scenario, members.plant)
    traces = [CaseTrace.of(subject, run, believed) for run in runs]
    lost = [trace for trace in traces if trace is None]
    if lost:
        return f"{len(lost)} of {len(traces)} cases of the set leave their envelope"
    good = [trace for trace in traces if trace is not None]
    queue = max(1, int(np.ceil(subject.law.delay)))
    late = max(max(trace.late for trace in good) + queue + 3, subject.quiet + queue + 3)
    if late > LATEST * good[0].e.shape[0]:
        since = late * scenario.period
        return f"s is reached, or a limit of the drives, as late as t = {since:.3g} s in cases of the set"
    return CaseRuns(subject, good, members.plants(corners), late)


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
class CaseTrace:
    """A run, relative to its reference and in units of periods."""

    subject: LoopProblem
    late: int
    q: Floats
    dq: Floats
    e: Floats
    v: Floats
    wanted: Floats
    command: Floats
    prior: tuple[Floats, Floats]
    last: tuple[Floats, Floats]
    disturbance: Floats
    rate: Floats
    s: Floats
    room: Floats
    belief: NominalModel

    @classmethod
    def of(cls, subject: LoopProblem, run: Run, first: NominalModel) -> CaseTrace | None:
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
            disturbance=signals["prior_disturbance"] * h * h,
            rate=signals["disturbance_rate"] * h**3,
            s=signals["kept_s"],
            room=room,
            belief=belief,
        )

    def margin(self, until: int) -> float:
        """The least margin up to a sample."""
        return float(self.room[: until + 1].min())

    def state(self, first: int, middle: CaseTrace) -> Floats:
        """Deviation from the nominal run at a decision [8 + Q, n]."""
        subject = self.subject
        m, queue = first - subject.quiet, max(1, int(np.ceil(subject.law.delay)))
        dead, before = int(subject.dead_time), first - 1
        rows = [self.e[m] - middle.e[m], self.v[m] - middle.v[m]]
        for i in range(queue):
            sets_in = before - i + dead
            moved = middle.v[sets_in + 1] - middle.v[sets_in]
            rows.append(self.command[before - i] + self.disturbance[before] - moved)
        rows += [self.prior[0][before] - self.e[m], self.prior[1][before] - self.v[m]]
        # In the last whole period: what the arm did beyond the command that acted.
        acted = m - 1 - dead
        unexplained = (self.v[m] - self.v[m - 1]) - self.command[acted]
        rows += [self.disturbance[before] - unexplained, self.rate[before]]
        loop = subject.loops[0]
        if loop.measures_velocity and loop.follows is not None:
            rows += [self.last[0][before] - self.e[m - 1], self.last[1][before] - self.v[m - 1]]
        else:
            rows += [np.zeros_like(rows[0]), np.zeros_like(rows[0])]
        return np.array(rows)


def _believed(first: NominalModel, signals: dict[str, Floats], times: Floats) -> NominalModel:
    """The law's learned model at each time."""
    if first.rotor is None:
        return first
    return replace(first, rotor=signals["rotor"], coulomb=signals["coulomb"], times=times)


@dataclass(frozen=True, eq=False)
class NominalRun:
    """The nominal run: the law's step iterated on `q̈ = q̈_wanted` without model error, disturbance, noise or limits.

    All other members are bounded by their deviation from it; K times at which torques start.

    - `motion`: of this arm from the sample of the first decision [N n], with the reference's velocities.
    - `error`: e when each torque starts [K n], rad or m.
    - `target`: `x = y + H s⁺`, for which the plan's equation is solved [K n], rad or m; None if it follows from ε.
    - `eps`: its ε [K n].
    - `sliding`: s in the law's memory [K n], rad/s or m/s; `s_next`: s⁺ [K n].
    - `cover`: u [K], N m; inf for a law without one.
    - `disturbance`: w* of this run itself [N n], and `rest`: its unexplained change in a period [N n], rad/s² or m/s²;
      None for a run without them.
    """

    motion: StateSequence
    error: Floats
    target: Floats | None
    eps: Floats
    sliding: Floats
    s_next: Floats
    cover: Floats
    disturbance: Floats | None = None
    rest: Floats | None = None


def planned_run(subject: LoopProblem, entry: InitialSet) -> NominalRun:
    """Return the planned run of a scenario's law, from an initial set to its end."""
    scenario, law = subject.scenario, subject.law
    h, dead, quiet = scenario.period, subject.dead_time, subject.quiet
    total = max(round(scenario.t1 / h), entry.sample + 4)
    set_in = (np.arange(entry.sample, total) + dead) * h
    begun = quiet + int(dead)
    part = (dead % 1.0) * h
    dq = entry.dq[begun]
    a = (entry.dq[begun + 1] - dq) / h
    first = State(jnp.asarray(entry.q[begun] + part * (dq + 0.5 * part * a)), jnp.asarray(dq + part * a))
    start = scenario.state0
    # As many as from the start of the run on, so that all entries share one compiled program.
    times = jnp.asarray(np.concatenate([set_in, np.full(total - set_in.size, set_in[-1])]))
    went = _followed(law, scenario.trajectory, start, first, jnp.asarray(entry.s), times)
    after, ddq, decided = jax.tree.map(lambda value: np.asarray(value)[: set_in.size], went)
    states = [
        np.concatenate([np.asarray(value)[None], many]) for value, many in zip((first.q, first.dq), after, strict=True)
    ]
    wanted = _references(scenario.trajectory, jnp.asarray(np.append(set_in, set_in[-1] + h)))
    e = states[0] - np.asarray(wanted.q)
    y = e + (float(law.horizon or h) - 0.5 * h) * (states[1] - np.asarray(wanted.dq))
    s_next = decided["s_next"]
    return NominalRun(
        motion=_at_samples(scenario, entry, states, ddq, set_in, quiet),
        error=e[:-1],
        target=y[:-1] + float(law.horizon or h) * s_next,
        eps=decided["eps1"],
        sliding=decided["s"],
        s_next=s_next,
        cover=decided["cover"][:, 0],
    )


def _at_samples(
    scenario: Scenario, entry: InitialSet, states: list[Floats], ddq: Floats, set_in: Floats, quiet: int
) -> StateSequence:
    """The motion at the arm's samples: measured until the first torque starts, then planned."""
    h = scenario.period
    t = h * np.arange(entry.sample - quiet, round(set_in[-1] / h - 1e-9) + 1)
    k = np.searchsorted(set_in, t + 1e-9) - 1
    at = np.maximum(k, 0)
    since = (t - set_in[at])[:, None]
    q, dq = states[0][at] + since * (states[1][at] + 0.5 * since * ddq[at]), states[1][at] + since * ddq[at]
    measured = int(np.sum(k < 0))
    q[:measured], dq[:measured] = entry.q[:measured], entry.dq[:measured]
    wanted = np.asarray(_references(scenario.trajectory, jnp.asarray(t)).dq)
    return StateSequence(t[:-1], q[:-1], dq[:-1], np.diff(dq, axis=0) / h, wanted[:-1])


@eqx.filter_jit
def _references(trajectory: Any, t: Any) -> Reference:
    return jax.vmap(trajectory.reference)(t)


@eqx.filter_jit
def _followed(law: SampledData, trajectory: Any, start: State, first: State, s: Any, set_in: Any) -> Any:
    """Positions and velocities after each period, its acceleration, and the step's signals."""
    h, n = law.period, law.joints
    zero = jnp.zeros(())
    memory = law.step.init(zero, start, trajectory.reference(zero), h, law.horizon)
    memory = eqx.tree_at(lambda kept: kept.s, memory, s)

    def step(carry: Any, t: Any) -> Any:
        state, memory = carry
        here, there = trajectory.reference(t), trajectory.reference(t + h)
        mass = law.nominal.mass(state.q)
        if law.adaptation is not None:
            mass = law.adaptation.mass_at_start(mass)
        moment = StepInput(
            t=t,
            state=state,
            reference=Reference(q=here.q, dq=here.dq, ddq=(there.dq - here.dq) / h),
            mass=mass,
            bias=law.nominal.bias(state.q, state.dq),
            robot=law.nominal,
            limits=law.limits,
            period=h,
            horizon=law.horizon,
            planned=jnp.ones((), bool),
            expected=state.dq,
        )
        decision = law.step(moment, memory)
        a = decision.acceleration
        after = State(q=state.q + h * (state.dq + 0.5 * h * a), dq=state.dq + h * a)
        signals = {name: decision.signals[name] for name in ("s", "s_next", "eps1")}
        signals["cover"] = jnp.full(n, jnp.inf) if decision.cover is None else jnp.broadcast_to(decision.cover, (n,))
        return (after, decision.memory), ((after.q, after.dq), a, signals)

    return jax.lax.scan(step, (first, memory), set_in)[1]


SILENT = {"sensor.resolution": 0.0, "sensor.position_noise": 0.0, "sensor.velocity_noise": 0.0}

SPARE = 4
"""Additional samples, so that the last torque starts."""


@dataclass(frozen=True, eq=False)
class NominalMember:
    """A run of the arm in the middle of a set, with sensors without rounding or noise."""

    subject: LoopProblem
    plant: Plant
    trace: CaseTrace
    run: Run

    @classmethod
    def of(cls, subject: LoopProblem) -> NominalMember | None:
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
        run = _silent(scenario).replace(controller=LoggingLaw(law), t1=longer)
        result = run.simulate(log_every=1, progress=False)
        trace = CaseTrace.of(subject, result, NominalModel.of(subject.scenario, members.plant))
        (plant,) = members.plants(np.full((1, axes), 0.5))
        return None if trace is None else cls(subject, plant, trace, result)

    def ideal(self, entry: InitialSet) -> NominalRun:
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
        motion = StateSequence(samples[:-1] * h, q[:-1], dq[:-1], np.diff(dq, axis=0) / h, wanted[:-1])
        at = decided + whole
        error = trace.e[at] + part * (trace.v[at] + 0.5 * part * (trace.v[at + 1] - trace.v[at]))
        assert self.run.log is not None
        signals = {name: np.asarray(self.run.log.signals[name])[decided] for name in ("s", "s_next", "eps1", "u")}
        disturbance = self._disturbance(motion)
        return NominalRun(
            motion=motion,
            error=error,
            target=None,
            eps=signals["eps1"],
            sliding=signals["s"],
            s_next=signals["s_next"],
            cover=signals["u"] if signals["u"].ndim == 1 else signals["u"][:, 0],
            disturbance=disturbance,
            rest=self._unexplained(motion, samples[:-1], disturbance),
        )

    def _disturbance(self, motion: StateSequence) -> Floats:
        """w* of this arm [N n], rad/s² or m/s²."""
        belief = self.trace.belief
        mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
        believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
        lacks = believed - rigid_body_torque([self.plant], motion)[1][0] + outer_torque([self.plant], motion)[0]
        return np.linalg.solve(mass, lacks[..., None])[..., 0]

    def _unexplained(self, motion: StateSequence, samples: NDArray[np.integer[Any]], disturbance: Floats) -> Floats:
        """`|a - q̈ + w*|` in the mean of each period [N n], rad/s² or m/s²: the effect of holding the torque."""
        h, dead = self.subject.scenario.period, self.subject.dead_time
        whole, part = int(dead), dead % 1.0
        decided = [np.maximum(samples - whole - k, 0) for k in (0, 1)]
        command = (1.0 - part) * self.trace.command[decided[0]] + part * self.trace.command[decided[1]]
        acceleration = (command + self.trace.wanted[samples]) / h**2
        later = np.concatenate([disturbance[1:], disturbance[-1:]])
        return np.abs(acceleration - motion.ddq + 0.5 * (disturbance + later))


def _silent(scenario: Scenario) -> Scenario:
    """The scenario with exact sensors; the law's parameters for them stay."""
    plant = scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant
    exact = with_changes(scenario, SILENT)
    if exact is None:
        return scenario
    sensor = (exact.plant.own if isinstance(exact.plant, MujocoPlant) else exact.plant).sensor
    return scenario.replace(plant=replace(plant, sensor=sensor))
