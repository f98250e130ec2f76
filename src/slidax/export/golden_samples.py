"""Golden samples: inputs of a guarded step and its results in Python, for the tests of the exported C code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from slidax.core.types import Command, Envelope, Memory, Reference, Scalar, State, Vector
from slidax.law.controllers import AbstractController
from slidax.motions.trajectory import AbstractMotion
from slidax.simulation.simulate import simulate

from .guarded_step import GuardedStep
from .status import HELD, Status, StepMemory

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

INSIDE = 0.95
"""Largest tracking error of a random sample, relative to its bound."""

BAD_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 5e-324, -1e-310)
"""Numbers that no sensor should deliver: not finite, huge or denormal."""

AT_ONCE = 100
"""Number of samples that one call of the compiled step processes."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

QUICKLY = {"xla_backend_optimization_level": 0}
"""XLA options without optimisation: compilation is four times as fast, and a few hundred samples need no fast code."""


def _compiled_quickly(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    jit: Any = eqx.filter_jit
    return jit(function, compiler_options=QUICKLY)


class StepSample(eqx.Module):
    """All inputs of a step except its parameters: memory, time [s], state, and reference now and one period later."""

    memory: StepMemory
    t: Scalar
    state: State
    now: Reference
    following: Reference


def random_samples(
    guard: GuardedStep, trajectory: AbstractMotion, period: float, t1: float, count: int, *, seed: int
) -> StepSample:
    """Draw random samples near a motion, inside the law's envelope; all arrays have the sample as first axis.

    - `trajectory`: the motion.
    - `period`, `t1`: sample time, and end of the motion [s].
    - `count`: number of samples.
    """
    keys = jax.random.split(jax.random.key(seed), count)
    first, drawn = _drawn(guard, trajectory, jnp.asarray(period), jnp.asarray(t1), keys)
    # Most samples have the memory after one step of the law, the others its initial memory.
    older = np.random.default_rng(seed).random(count) < 0.8
    memory = jax.tree.map(
        lambda a, b: jnp.where(older.reshape(-1, *[1] * (a.ndim - 1)), a, b),
        answer(guard, first)[0].memory,
        first.memory,
    )
    return eqx.tree_at(lambda sample: sample.memory, drawn, memory)


def answer(guard: GuardedStep, samples: StepSample) -> tuple[Command, Status]:
    """Return the step's command and status for each sample, computed one sample at a time as in a run."""
    count = len(samples.t)
    arrays = jax.tree.map(np.asarray, samples)
    # All calls have the same size and dtypes, so that the step, which is long, is compiled only once.
    guard = jax.tree.map(lambda x: jnp.asarray(x, x.dtype), guard)
    pieces = []
    for first in range(0, count, AT_ONCE):
        which = np.minimum(np.arange(first, first + AT_ONCE), count - 1)
        piece = jax.tree.map(lambda x, which=which: jnp.asarray(x[which]), arrays)
        pieces.append(jax.tree.map(np.asarray, _answered(guard, piece)))
    return jax.tree.map(lambda *parts: jnp.asarray(np.concatenate(parts)[:count]), *pieces)


@_compiled_quickly
def _answered(guard: GuardedStep, samples: StepSample) -> tuple[Command, Status]:
    def step(sample: StepSample) -> tuple[Command, Status]:
        return guard.step(sample.t, sample.state, sample.now, sample.following, sample.memory)

    return jax.lax.map(step, samples)


@_compiled_quickly
def _drawn(
    guard: GuardedStep, trajectory: AbstractMotion, period: Scalar, t1: Scalar, keys: Array
) -> tuple[StepSample, StepSample]:
    """Return two consecutive samples for each key, both with the memory before the first."""

    def two(key: Array) -> tuple[StepSample, StepSample]:
        keys = jax.random.split(key, 4)
        n = guard.joints
        t = period * jnp.floor(jax.random.uniform(keys[0], (), minval=1.0, maxval=t1 / period))
        before, now, following = (trajectory.reference(t + k * period) for k in (-1, 0, 1))
        share = jax.random.uniform(keys[1], (n,), minval=-1.0, maxval=1.0)
        error = _inside(guard, t, before, share)
        rate = jax.random.normal(keys[2], (n,)) * 10.0 ** jax.random.uniform(keys[3], (), minval=-3.0, maxval=1.0)
        # Near its bounds the error decreases, and by less than its own size, so that the next error is inside too.
        rate = jnp.where(jnp.abs(share) > 0.5, -jnp.sign(error) * jnp.abs(rate), rate)
        fastest = 0.2 * jnp.abs(error) / (jnp.abs(share) * period)
        rate = jnp.clip(rate, -fastest, fastest)
        last = State(q=before.q + error, dq=before.dq + rate)
        memory = guard.init(t - period, last, before)
        moved = error + period * rate
        state = State(q=now.q + moved, dq=now.dq + rate)
        return StepSample(memory, t - period, last, before, now), StepSample(memory, t, state, now, following)

    return jax.lax.map(two, keys)


def _inside(guard: GuardedStep, t: Scalar, reference: Reference, share: Vector) -> Vector:
    """Return a tracking error inside the envelope [n]; without an envelope, within 0.5 rad or 0.5 m.

    - `share`: wanted size of the error relative to its bound, in [-1, 1] [n].
    """
    side = State(q=reference.q + 1e-6 * jnp.sign(share), dq=reference.dq)
    envelope = guard.envelope(t, guard.init(t, side, reference))
    if envelope is None:
        return 0.5 * share
    return INSIDE * jnp.where(share > 0, share * envelope.upper, -share * envelope.lower)


def with_bad_numbers(samples: StepSample) -> StepSample:
    """Return copies of samples, in each of which one number is replaced by one of `BAD_NUMBERS`, such as NaN."""

    def places(sample: StepSample) -> list[Any]:
        return [sample.t, sample.state.q, sample.state.dq, sample.now.q, sample.following.dq]

    parts = [np.array(x) for x in places(samples)]
    count = len(parts[0])
    rng = np.random.default_rng(count)
    for k in range(count):
        part = parts[rng.choice(len(parts), p=[0.1, 0.4, 0.3, 0.1, 0.1])]
        row = part[k : k + 1].reshape(-1)
        row[rng.integers(row.size)] = BAD_NUMBERS[k % len(BAD_NUMBERS)]
    return eqx.tree_at(places, samples, [jnp.asarray(part) for part in parts])


@dataclass(frozen=True)
class Recording:
    """Samples of a closed loop, each array with the sample as first axis.

    - `samples`: the step's inputs.
    - `tau`: commanded torque [samples n]; an actuator may deliver another torque.
    - `status`: status of each sample [samples].
    """

    samples: StepSample
    tau: np.ndarray
    status: np.ndarray


class _Recorded(AbstractController):
    """A guarded step that logs its inputs, command and status as signals."""

    guard: GuardedStep

    @property
    def joints(self) -> int:
        return self.guard.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> StepMemory:
        return self.guard.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: StepMemory
    ) -> Command:
        command, status = self.guard.step(t, state, reference_now, reference_next, memory)
        got = jax.tree.leaves(StepSample(memory, t, state, reference_now, reference_next))
        signals = {f"{k:03}": leaf.astype(float) for k, leaf in enumerate(got)}
        signals |= {"status": status.astype(float), "tau": command.tau}
        return Command(tau=command.tau, memory=command.memory, signals=signals)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.guard.envelope(t, memory)


def record_closed_loop(scenario: Scenario, guard: GuardedStep, t1: float | None = None) -> Recording:
    """Simulate a scenario's closed loop until `t1` [s] and record the step's inputs, commands and statuses."""
    run = simulate(
        scenario.plant,
        _Recorded(guard),
        scenario.trajectory,
        scenario.state0,
        t1=scenario.t1 if t1 is None else t1,
        stepping=scenario.stepping,
        mode="held",
        outside="recover",
        engine="auto",
        progress=False,
    )
    assert run.log is not None
    t, state = jnp.zeros(()), scenario.state0
    reference = scenario.trajectory.reference(t)
    like = StepSample(jax.eval_shape(guard.init, t, state, reference), t, state, reference, reference)
    logged = [np.asarray(run.log.signals[f"{k:03}"]) for k in range(len(jax.tree.leaves(like)))]
    arrays = [values.astype(leaf.dtype) for values, leaf in zip(logged, jax.tree.leaves(like), strict=True)]
    samples: StepSample = jax.tree.unflatten(jax.tree.structure(like), arrays)
    return Recording(samples, np.asarray(run.log.signals["tau"]), np.asarray(run.log.signals["status"]).astype(int))


OF_A_RUN, RANDOM, BAD = 200, 200, 100
"""Number of golden samples from a closed loop, of random samples, and of samples with a bad number."""

TOLERANCE = {"double": 1e-12, "float": 1e-6}
"""Largest difference between Python and C, relative to the size of the compared quantity, by number type."""

PERTURBATIONS = 4
"""Number of random changes of the inputs' last digits that determine the sensitivity of a result."""

SLACK = 30.0
"""Tolerance of a result, relative to its change with the inputs' last digits."""

LOOSE, NO_MATTER = 0.1, 1e30
"""Tolerances for a law whose search has looser tolerances in floats.

The first is the relative tolerance of its torque in a closed loop, the second that of all other results. Outside its
envelope such a law computes other torques in floats, since it keeps a larger distance from the envelope.
"""


@dataclass(frozen=True)
class GoldenSamples:
    """Samples with the step's results.

    - `rows`: for each sample, the numbers of five structures: measurement, reference, memory before the step, command
      and memory after it. Each structure is a list in the order of its members.
    - `statuses`: status of each sample.
    - `within`: for each sample, the tolerance of each member of the command, and of each member of the memory.
    """

    rows: list[list[list[Any]]]
    statuses: list[int]
    within: list[list[list[float]]]


def golden_samples(scenario: Scenario, guard: GuardedStep, real: str, *, same: bool) -> GoldenSamples:
    """Return inputs and answers of the step in Python, with which the test of the exported C code compares its own.

    The inputs are from the scenario's closed loop, random, or have numbers that are not finite or out of range. Samples
    whose returned status depends on the inputs' last digits are left out.

    - `guard`: the step, with its checks of measurements, references and torques.
    - `real`: number type of the C code, "double" or "float".
    - `same`: True if the C code has the constants of this step. False, as for code that rounds them, leaves the closed
      loop's samples, whose torques are compared with a wide tolerance, and samples with a held command, of which only
      the status is compared.
    """
    drawn = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, RANDOM + BAD, seed=1)
    good, bad = (jax.tree.map(lambda x, part=part: x[part], drawn) for part in (slice(RANDOM), slice(RANDOM, None)))
    run = _of_the_run(scenario, guard)
    samples: StepSample = jax.tree.map(lambda *parts: jnp.concatenate(parts), run, good, with_bad_numbers(bad))
    last_digit = 2.0**-51
    if real == "float":
        guard, samples = _rounded((guard, samples))
        last_digit = 2.0**-23
    command, status = answer(guard, samples)
    off, firm = sample_sensitivity(guard, samples, command, status, last_digit)
    parts = (
        (samples.t, samples.state),
        (samples.now, samples.following),
        samples.memory,
        (command.tau, command.signals),
        command.memory,
    )
    rows = [_numbers(part) for part in parts]
    allowed = np.maximum(TOLERANCE[real] * largest_values(command), SLACK * np.minimum(off, NO_MATTER))
    if not same:
        allowed = np.full_like(allowed, NO_MATTER)
        allowed[:OF_A_RUN, 0] = LOOSE * largest_values(command)[:OF_A_RUN, 0]
        firm = [k for k in firm if k < OF_A_RUN or int(status[k]) & HELD]
    # The leaves of a command are the torque, the memory and the signals, in this order.
    kept = len(jax.tree.leaves(command.memory))
    return GoldenSamples(
        rows=[[part[k] for part in rows] for k in firm],
        statuses=[int(status[k]) for k in firm],
        within=[[[allowed[k, 0], *allowed[k, 1 + kept :]], [*allowed[k, 1 : 1 + kept]]] for k in firm],
    )


def _of_the_run(scenario: Scenario, guard: GuardedStep) -> StepSample:
    """Return `OF_A_RUN` samples of the closed loop: a quarter of them from its start, the others evenly spread."""
    samples = record_closed_loop(scenario, guard).samples
    count = len(samples.t)
    first = min(OF_A_RUN // 4, count - 1)
    which = np.concatenate([np.arange(first), np.linspace(first, count - 1, OF_A_RUN - first).astype(int)])
    return jax.tree.map(lambda values: jnp.asarray(values[which]), samples)


def _rounded(tree: Any) -> Any:
    """Return a tree with its numbers rounded to single precision, but stored as doubles."""
    return jax.tree.map(
        lambda x: x.astype(jnp.float32).astype(x.dtype) if jnp.issubdtype(x.dtype, jnp.inexact) else x, tree
    )


def sample_sensitivity(
    guard: GuardedStep, samples: StepSample, command: Command, status: Status, last_digit: float
) -> tuple[np.ndarray, list[int]]:
    """Return how sensitive the step's results are to the last digits of its inputs and parameters.

    Changes these digits at random, `PERTURBATIONS` times. Returns the largest change of each array in the command,
    [samples arrays], and the indices of the samples whose status never changed.

    - `command`, `status`: results for the unchanged inputs.
    - `last_digit`: size of the last digit, relative to the number.
    """
    rng = np.random.default_rng(3)

    def nudged(x: Any) -> Any:
        if not jnp.issubdtype(x.dtype, jnp.inexact):
            return x
        return x * (1.0 + last_digit * rng.choice([-1.0, 1.0], x.shape))

    worst = np.zeros((len(status), len(jax.tree.leaves(command))))
    firm = np.ones(len(status), bool)
    for _ in range(PERTURBATIONS):
        moved, other = answer(jax.tree.map(nudged, guard), jax.tree.map(nudged, samples))
        firm &= np.asarray(other) == np.asarray(status)
        with np.errstate(invalid="ignore"):
            change = jax.tree.map(lambda a, b: np.asarray(a, float) - np.asarray(b, float), moved, command)
        worst = np.fmax(worst, largest_values(change))
    return worst, np.flatnonzero(firm).tolist()


def largest_values(tree: Any) -> np.ndarray:
    """Return the largest finite absolute value of each array in a tree for each sample, [samples arrays], else 0."""
    leaves = [np.abs(np.asarray(leaf, float)).reshape(len(leaf), -1) for leaf in jax.tree.leaves(tree)]
    return np.stack([np.where(np.isfinite(leaf), leaf, 0.0).max(1) for leaf in leaves], axis=1)


def _numbers(tree: Any) -> list[list[Any]]:
    """Return one list per sample: its numbers in the order of the tree's leaves, each leaf a list or a number."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]

    def row(k: int) -> list[Any]:
        return [leaf[k].ravel().tolist() if leaf.ndim > 1 else leaf[k].item() for leaf in leaves]

    return [row(k) for k in range(len(leaves[0]))]
