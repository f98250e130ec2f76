"""Simulation of many closed loops at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError, is_traced
from slidax._types import State
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

from . import native_engine
from .define import constant, define_loop, windows_of
from .engine import engine_for_batch, native_or_xla
from .loop import Loop
from .mujoco_plant import MujocoPlant
from .plant import Plant
from .run import Run
from .simulate import BANDS, simulate
from .stepping import Stepping
from .tally import Windows

Parts = (
    tuple[Plant | MujocoPlant, AbstractController, AbstractTrajectory, State]
    | tuple[Plant | MujocoPlant, AbstractController, AbstractTrajectory, State, PrescribedPerformance]
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
    """Simulate `define(varied[0])`, `define(varied[1])`, ... and return one `Run`.

    Its arrays have the run as their first axis, as with `jax.vmap` of `simulate`; `runs[i]` is one of them.

    Several runs at a time use the vector units of each core. Values that they share are computed once for several:
    reference, envelope and disturbance, if only gains vary. The bits of a run depend neither on the other runs nor on
    the number of threads.

    - `define`: maps one run's varied values to `(plant, controller, trajectory, state0)`, with the tolerance band as
      an optional fifth. Pure and traced by JAX, so its values are not checked; read `run.outcomes`.
    - `varied`: a pytree of arrays with the run as their first axis.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`, equal for all runs. The engine "xla" is `jax.vmap`;
      "cuda" uses an NVIDIA card, with a thread for each run.
    - `log_every`: log one in so many samples; None logs none. `run.log.valid` marks the valid samples.
    - `threads`: of the native engine; None for as many as there are cores.

    Raises DefinitionError if the parts do not fit each other, the arrays differ in their first axis, or the engine is
    "cuda" and CuPy or a card is missing.
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
    """The common part of a batch's runs. Equal requests share compiled code."""

    define: Callable[[Any], Parts]
    t1: float
    stepping: Stepping
    log_every: int | None
    bands: tuple[float, ...]

    def simulate(self, values: Any) -> Run:
        """Run with one run's varied values, by XLA."""
        options = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "define"}
        return simulate(*self.define(values), **options)

    def loop(self, values: Any) -> tuple[Loop, State, int, tuple[tuple[str, ...], tuple[str, ...]]]:
        """Return the loop, the first state, the number of samples, and the units and names of the joints."""
        plant, controller, trajectory, state0, *tolerance = self.define(values)
        if isinstance(plant, MujocoPlant):
            raise DefinitionError("MuJoCo moves one arm at a time: give a `Plant`, or call `simulate` for each run")
        loop, samples = define_loop(
            plant, controller, trajectory, state0, self.t1, self.stepping, self.log_every, self.bands, *tolerance
        )
        return loop, state0, samples, (plant.robot.joint_units, plant.robot.joint_names)

    def start(self, values: Any) -> tuple[Loop, State]:
        """Return the loop and the first state, as the native engine takes them."""
        return self.loop(values)[:2]

    def shape(self, values: Any) -> tuple[int, tuple[tuple[str, ...], tuple[str, ...]]]:
        """Return the number of samples, and the units and names of the joints."""
        *_, samples, joints = eqx.filter_eval_shape(self.loop, values)
        return samples, joints

    def clock(self, samples: int) -> tuple[Windows, np.ndarray, np.ndarray]:
        """Return the windows, the period and the end of each run."""
        period = self.stepping.period
        return windows_of(samples - 1, period, self.bands), np.asarray(period, float), np.asarray(self.t1, float)


def run_of(
    log: Any, carry: tuple[Any, ...], clock: tuple[Any, ...], joints: tuple[Any, Any], *, has_envelope: bool
) -> Run:
    """Return a run from the results of the native engine.

    - `carry`: tally, fault, excursion, last good state.
    - `clock`, `joints`: as in `BatchRequest`.
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
    """Return the part of a carry that `run_of` takes."""
    return carry.tally, carry.fault, carry.excursion, carry.good


def _run_natively(request: BatchRequest, varied: Any, threads: int | None, machine: str) -> Run:
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), varied)
    samples, joints = request.shape(shapes)
    (carry, envelope, *_), log = native_engine.drive_batch(
        request, request.start, shapes, varied, samples, request.log_every, threads, machine
    )
    runs = jax.tree.leaves(varied)[0].shape[0]
    # By NumPy: JAX would compile a program for each shape, which takes longer than few runs.
    clock = jax.tree.map(lambda x: constant(np.broadcast_to(x, (runs, *np.shape(x)))), request.clock(samples))
    arrays = log, results_of(carry), clock
    # Made from the first run, whose shapes are those of the declarations, and then filled with all runs.
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
