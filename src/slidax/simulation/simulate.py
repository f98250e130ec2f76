"""Simulation of one closed loop or of a batch, and gradients of metrics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from slidax.core.errors import DefinitionError, OutcomeError, as_array, is_traced
from slidax.core.types import Scalar, State
from slidax.law.controllers import AbstractController
from slidax.law.error_transformations import PrescribedPerformance
from slidax.motions.trajectory import AbstractMotion

from . import native_engine, xla_engine
from .define import constant, define_loop, require_log_fits, windows_of
from .engine import EngineResult, RunRequest, engine_for, engine_for_batch, native_or_xla
from .loop import ClosedLoop, begin
from .mujoco_engine import drive as drive_mujoco
from .native_loop import Dual, jvp
from .plant import MujocoPlant, Plant
from .run import Run
from .stepping import Stepping
from .tally import Windows

BANDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-8)
"""Default error bands for the settling time, rad or m."""


def simulate(
    plant: Plant | MujocoPlant,
    controller: AbstractController,
    trajectory: AbstractMotion,
    state0: State,
    tolerance: PrescribedPerformance | None = None,
    *,
    t1: float,
    stepping: Stepping | None = None,
    log_every: int | None = 1,
    bands: tuple[float, ...] = BANDS,
    throw: bool = False,
    progress: bool | None = None,
    **changes: Any,
) -> Run:
    """Simulate the closed loop from 0 to `t1`, sampled at `k period`, k = 0 .. N: N + 1 samples for N periods.

        simulate(plant, controller, trajectory, State([0.2, 0.8]), t1=10.0, period=1e-3)

    Each evaluation of the law checks that the error is inside the envelope and all values are finite. The first
    violation ends the run, and `run.outcome` describes it. With `outside="recover"` a run continues outside its
    envelope, for a law that is defined there, and the outcome has the times of leaving and returning. In continuous
    mode the logged torque of sample k is the torque at the start of step k.

    - `plant`: the true robot with its disturbance; a `MujocoPlant` needs held mode.
    - `controller`: the control law.
    - `trajectory`: reference motion of the joints.
    - `state0`: the true state at t = 0.
    - `tolerance`: tolerance band of the error, by which the run is judged independently of the controller's envelope;
      see `metrics.tolerance_margin` and `metrics.tolerance_violations`.
    - `t1`: end [s], a whole number of periods.
    - `stepping`: period, mode, integrator, engine.
    - `log_every`: n to log every n-th sample; None for no log. Metrics always use all samples.
    - `bands`: error bands for the settling time, rad or m.
    - `throw`: True to raise OutcomeError on a bad outcome, instead of returning the run.
    - `progress`: True to show a progress bar; None shows it for long runs if standard error is a terminal.
    - `changes`: fields of `Stepping` by keyword, which replace those of `stepping`: `period`, `mode`, `substeps`,
      `integrator`, `outside`, `limits`, `engine`. Either argument must set `period`.

    `simulate` also works inside `jit`, `vmap` and `grad`: by XLA, without checks of the values and without a progress
    bar. Then `run.log.valid` marks the valid samples. Use `simulate_batch` for many runs.

    Raises DefinitionError if the parts do not fit each other, the start is outside the envelope or the tolerance band,
    the actuator cannot hold the arm at the start, or the start or the motion exceeds the joint limits. Raises
    NoNativeCodeError if `engine` is "native" and a part of the loop has no machine code.
    """
    stepping = Stepping.of(stepping, changes)
    own = plant.with_friction if isinstance(plant, MujocoPlant) else plant
    loop, samples = define_loop(own, controller, trajectory, state0, t1, stepping, log_every, bands, tolerance)
    traced = is_traced((plant, loop, state0))
    if log_every is not None and not traced:
        require_log_fits(loop, state0, -(-samples // log_every))
    if isinstance(plant, MujocoPlant):
        _require_samples(stepping.mode, traced)
    timing = load = None
    if traced:
        carry, envelope, *_ = begin(loop, state0)
        points = -(-samples // (log_every or 1))
        carry, log = xla_engine.advance(loop, carry, points, log_every, pack=False)
    else:
        request = RunRequest(loop, state0, samples, log_every, progress)
        (carry, envelope, *_), log, timing, load = _run_engine(plant, stepping.engine, request)
    run = Run(
        log=log,
        tally=carry.tally,
        windows=loop.windows,
        fault=carry.fault,
        excursion=carry.excursion,
        state=carry.good,
        period=loop.period,
        t1=constant(float(t1)),
        joint_units=plant.robot.joint_units,
        joint_names=plant.robot.joint_names,
        has_envelope=envelope is not None,
        timing=timing,
        load=load,
    )
    if throw and not traced and not run.outcome.ok:
        raise OutcomeError(run.outcome, run)
    return run


def _run_engine(plant: Plant | MujocoPlant, engine: str, request: RunRequest) -> EngineResult:
    if isinstance(plant, MujocoPlant):
        return drive_mujoco(plant, engine, request)
    return native_or_xla(
        engine,
        engine_for(engine),
        lambda: native_engine.drive(request),
        lambda: xla_engine.drive(request),
        stacklevel=4,
    )


def _require_samples(mode: str, traced: bool) -> None:
    if mode == "continuous":
        raise DefinitionError("a MujocoPlant needs samples: simulate in held mode, not in continuous mode")
    if traced:
        raise DefinitionError(
            "MuJoCo cannot be traced: simulate outside `jit`, `vmap` and `grad`, or simulate a `Plant`"
        )


Parts = (
    tuple[Plant | MujocoPlant, AbstractController, AbstractMotion, State]
    | tuple[Plant | MujocoPlant, AbstractController, AbstractMotion, State, PrescribedPerformance]
)
"""Plant, controller, trajectory, state at t = 0, and optionally the tolerance band that judges the run."""


def simulate_batch(
    define: Callable[[Any], Parts],
    varied: Any,
    *,
    t1: float,
    stepping: Stepping | None = None,
    log_every: int | None = None,
    bands: tuple[float, ...] = BANDS,
    threads: int | None = None,
    **changes: Any,
) -> Run:
    """Simulate `define(varied[0])`, `define(varied[1])`, ... and return all runs as one `Run`.

    All arrays of the result have the run as their first axis, as with `jax.vmap` of `simulate`; `runs[i]` is one run.

    The vector units of each core advance several runs at a time. Values that are equal in these runs are computed once:
    for example reference, envelope and disturbance, if only gains vary. A run's results are bitwise independent of the
    other runs and of the number of threads.

    - `define`: maps one run's varied values to `(plant, controller, trajectory, state0)`, optionally followed by the
      tolerance band. It must be pure. JAX traces it, so the parts' values are not checked; read `run.outcomes`.
    - `varied`: a pytree of arrays with the run as their first axis.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`, equal for all runs. The engine "xla" uses `jax.vmap`;
      "cuda" uses an NVIDIA GPU, with a thread for each run.
    - `log_every`: n to log every n-th sample; None for no log. `run.log.valid` marks the valid samples.
    - `threads`: number of threads of the native engine; None for one per core.

    Raises DefinitionError if the parts do not fit each other, the arrays differ in their first axis, or the engine is
    "cuda" and CuPy or a GPU is missing. Raises NoNativeCodeError if the engine is "native" or "cuda" and a part of the
    loop has no machine code.
    """
    varied = jax.tree.map(jnp.asarray, varied)
    _require_one_length(varied)
    request = BatchRequest(define, float(t1), Stepping.of(stepping, changes), log_every, tuple(bands))
    many = jax.vmap(request.simulate)
    if is_traced(varied):
        return many(varied)
    engine = request.stepping.engine
    machine = engine_for_batch(engine)
    return native_or_xla(
        engine, machine, lambda: _run_natively(request, varied, threads, machine), lambda: jax.jit(many)(varied)
    )


@dataclass(frozen=True)
class BatchRequest:
    """Arguments that all runs of a batch have in common, as in `simulate_batch`. Equal requests share compiled code."""

    define: Callable[[Any], Parts]
    t1: float
    stepping: Stepping
    log_every: int | None
    bands: tuple[float, ...]

    def simulate(self, values: Any) -> Run:
        """Simulate one run of the batch, by XLA."""
        options = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "define"}
        return simulate(*self.define(values), **options)

    def loop(self, values: Any) -> tuple[ClosedLoop, State, int, tuple[tuple[str, ...], tuple[str, ...]]]:
        """Return one run's loop, its state at t = 0, the number of samples, and the joints' units and names."""
        plant, controller, trajectory, state0, *tolerance = self.define(values)
        if isinstance(plant, MujocoPlant):
            raise DefinitionError("MuJoCo moves one arm at a time: use a `Plant`, or call `simulate` for each run")
        loop, samples = define_loop(
            plant, controller, trajectory, state0, self.t1, self.stepping, self.log_every, self.bands, *tolerance
        )
        return loop, state0, samples, (plant.robot.joint_units, plant.robot.joint_names)

    def start(self, values: Any) -> tuple[ClosedLoop, State]:
        """Return one run's loop and its state at t = 0, as the native engine takes them."""
        return self.loop(values)[:2]

    def shape(self, values: Any) -> tuple[int, tuple[tuple[str, ...], tuple[str, ...]]]:
        """Return the number of samples of each run, and the joints' units and names."""
        *_, samples, joints = eqx.filter_eval_shape(self.loop, values)
        return samples, joints

    def clock(self, samples: int) -> tuple[Windows, np.ndarray, np.ndarray]:
        """Return the statistics' windows, the period [s] and the end [s], which all runs share.

        - `samples`: number of samples of each run.
        """
        period = self.stepping.period
        return windows_of(samples - 1, period, self.bands), np.asarray(period, float), np.asarray(self.t1, float)


def run_of(
    log: Any, carry: tuple[Any, ...], clock: tuple[Any, ...], joints: tuple[Any, Any], *, has_envelope: bool
) -> Run:
    """Return a run from the results of the native engine.

    - `log`: the run's log; None without one.
    - `carry`: statistics, fault, excursion and last state without a fault, from `results_of`.
    - `clock`: windows of the statistics, period and end, from `BatchRequest.clock`.
    - `joints`: units and names of the joints.
    """
    tally, fault, excursion, state = carry
    windows, period, t1 = clock
    units, names = joints
    return Run(
        log=log,
        tally=tally,
        windows=windows,
        fault=fault,
        excursion=excursion,
        state=state,
        period=period,
        t1=t1,
        joint_units=units,
        joint_names=names,
        has_envelope=has_envelope,
    )


def results_of(carry: Any) -> tuple[Any, ...]:
    """Return a carry's tally, fault, excursion and last state without a fault, for `run_of`."""
    return carry.tally, carry.fault, carry.excursion, carry.good


def _run_natively(request: BatchRequest, varied: Any, threads: int | None, machine: str) -> Run:
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), varied)
    samples, joints = request.shape(shapes)
    (carry, envelope, *_), log = native_engine.drive_batch(
        request, request.start, shapes, varied, samples, request.log_every, threads, machine
    )
    runs = jax.tree.leaves(varied)[0].shape[0]
    # NumPy repeats the values, since JAX would compile a program for each shape, which takes longer than a few runs.
    clock = jax.tree.map(lambda x: constant(np.broadcast_to(x, (runs, *np.shape(x)))), request.clock(samples))
    arrays = log, results_of(carry), clock
    # Build the structure from the first run, since field types require its shapes; then insert the arrays of all runs.
    one_log, one_carry, one_clock = jax.tree.map(lambda x: constant(np.asarray(x)[0, ...]), arrays)
    first = run_of(one_log, one_carry, one_clock, joints, has_envelope=envelope is not None)
    log, (tally, fault, excursion, state), (windows, period, t1) = arrays
    leaves = jax.tree.leaves((log, tally, windows, fault, excursion, state, period, t1))
    return jax.tree.unflatten(jax.tree.structure(first), leaves)


def _require_one_length(varied: Any) -> None:
    shapes = [leaf.shape for leaf in jax.tree.leaves(varied)]
    if not shapes or any(not shape for shape in shapes) or len({shape[0] for shape in shapes}) > 1 or not shapes[0][0]:
        raise DefinitionError(
            "`varied` must hold arrays with the run as their first axis, all of one length >= 1; "
            f"got shapes {', '.join(map(str, shapes)) or 'none'}"
        )


def value_and_gradient(
    metric: Callable[[Run], Scalar],
    define: Callable[[Any], Parts],
    at: Any,
    *,
    t1: float,
    stepping: Stepping | None = None,
    log_every: int | None = None,
    bands: tuple[float, ...] = BANDS,
    **changes: Any,
) -> tuple[Scalar, Any]:
    """Return `J(x)` and `dJ/dx`, a tree like x, for `J(x) = metric(simulate(*define(x)))`, in forward mode.

    The run and its derivatives in all directions of x advance together, eight directions in parallel. This suits up to
    some dozens of parameters: it stores no states, and compiles in seconds. `jax.grad` of `simulate` takes the time of
    a few runs for any number of parameters. But it stores every state, and XLA compiles it for minutes for an arm with
    seven joints.

    - `metric`: maps a run to one number; pure, as inside `jax.grad`. `run.log.valid` marks the valid samples.
    - `define`: maps x to `(plant, controller, trajectory, state0)`, optionally followed by the tolerance band; pure,
      and traced by JAX.
    - `at`: x, a tree of numbers and arrays.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`; the engine "xla" uses `jax.jvp`.
    - `log_every`: n to log every n-th sample for the metric; None for no log.

    Raises DefinitionError if `at` has no numbers, or the parts do not fit each other.
    """
    at = jax.tree.map(as_array, at)
    numbers, unravel = ravel_pytree(at)
    if not numbers.size:
        raise DefinitionError("`at` must have the numbers with respect to which to differentiate; it has none")
    directions = jax.vmap(unravel)(jnp.eye(numbers.size))
    request = BatchRequest(define, float(t1), Stepping.of(stepping, changes), log_every, tuple(bands))

    def by_xla(at: Any, directions: Any) -> tuple[Scalar, Any]:
        many: Any = jax.vmap(lambda v: jax.jvp(lambda x: metric(request.simulate(x)), (at,), (v,)), out_axes=(None, 0))
        return many(directions)

    engine = request.stepping.engine
    value, slopes = native_or_xla(
        engine,
        engine_for(engine),
        lambda: _differentiate_natively(metric, request, at, directions),
        lambda: jax.jit(by_xla)(at, directions),
    )
    return value, unravel(slopes)


def _differentiate_natively(
    metric: Callable[[Run], Scalar], request: BatchRequest, at: Any, directions: Any
) -> tuple[Scalar, Any]:
    samples, joints = request.shape(at)
    (carry, envelope, *_), log = native_engine.drive_duals(
        request, request.start, at, directions, samples, request.log_every
    )
    clock = jax.tree.map(jnp.asarray, request.clock(samples))

    def metric_of(results: tuple[Any, ...]) -> Scalar:
        log, *rest = results
        return metric(run_of(log, tuple(rest), clock, joints, has_envelope=envelope is not None))

    log = Dual(None, None) if log is None else log
    # The run itself is equal in all directions.
    value = jax.tree.map(lambda x: x[0], (log.value, *results_of(carry.value)))
    tangent = jax.tree.map(jnp.asarray, (log.tangent, *results_of(carry.tangent)))
    return jax.vmap(lambda v: jvp(metric_of, value, v), out_axes=(None, 0))(tangent)
