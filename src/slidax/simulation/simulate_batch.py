"""Many closed loops at once."""

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
from slidax.codegen import NoNativeCodeError
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

from . import native_engine
from .define import constant, define_loop, windows_of
from .engine import engine_for_batch, say_xla_instead
from .loop import Loop
from .mujoco_plant import MujocoPlant
from .plant import Plant
from .run import Run
from .simulate import BANDS, simulate
from .stepping import Stepping

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
    """The closed loops of `define(varied[0])`, `define(varied[1])`, ... as one `Run`.

    Its arrays have the run as their first axis, as those of `jax.vmap` of `simulate`; `runs[i]` is one of them.

    The runs go several at a time through the vector units of each core. What they share is computed once for several,
    and all of it if only gains vary: reference, envelope and disturbance. The bits of a run depend neither on the
    others nor on the number of threads.

    - `define`: maps one run's varied values to `(plant, controller, trajectory, state0)`, with the tolerance band as
      an optional fifth. Pure and traced by JAX, so its values are not checked; read `run.outcomes`.
    - `varied`: a pytree of arrays with the run as their first axis.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`, the same for all; the engine "xla" is `jax.vmap`, and
      "cuda" an NVIDIA card, each run in a thread of its own.
    - `log_every`: log one in so many samples; None logs none. `run.log.valid` marks what is good.
    - `threads`: of the native engine; None: as many as there are cores.

    Raises DefinitionError if the parts do not fit each other, the arrays have not one first axis, or the engine is
    "cuda" and CuPy or a card is missing.
    """
    varied = jax.tree.map(jnp.asarray, varied)
    _require_one_length(varied)
    task = Task(define, float(t1), Stepping.of(stepping, changes), log_every, tuple(bands))
    engine = task.stepping.engine
    on = "xla" if is_traced(varied) else engine_for_batch(engine)
    if on != "xla":
        try:
            return _natively(task, varied, threads, on)
        except NoNativeCodeError as error:
            if engine == on:
                raise
            say_xla_instead(f"there is {error.message}")
    many = jax.vmap(task.simulated)
    return many(varied) if is_traced(varied) else jax.jit(many)(varied)


@dataclass(frozen=True)
class Task:
    """What the runs of a batch have in common."""

    define: Callable[[Any], Parts]
    t1: float
    stepping: Stepping
    log_every: int | None
    bands: tuple[float, ...]

    def simulated(self, given: Any) -> Run:
        """The run, by XLA."""
        how = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "define"}
        return simulate(*self.define(given), **how)

    def loop(self, given: Any) -> tuple[Loop, State, int, tuple[tuple[str, ...], tuple[str, ...]]]:
        """The loop, the first state, how many samples, and the units and names of the joints."""
        plant, controller, trajectory, state0, *tolerance = self.define(given)
        if isinstance(plant, MujocoPlant):
            raise DefinitionError("MuJoCo moves one arm at a time: give a `Plant`, or call `simulate` for each run")
        loop, samples = define_loop(
            plant, controller, trajectory, state0, self.t1, self.stepping, self.log_every, self.bands, *tolerance
        )
        return loop, state0, samples, (plant.robot.joint_units, plant.robot.joint_names)


def _natively(task: Task, varied: Any, threads: int | None, on: native_engine.OurOwn) -> Run:
    one = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape[1:], x.dtype), varied)
    *_, samples, (units, names) = eqx.filter_eval_shape(task.loop, one)
    (carry, envelope, *_), log = native_engine.drive_batch(
        task, lambda given: task.loop(given)[:2], one, varied, samples, task.log_every, threads, on
    )
    runs = jax.tree.leaves(varied)[0].shape[0]
    step = task.stepping.period
    shared = windows_of(samples - 1, step, task.bands), np.asarray(step, float), np.asarray(task.t1, float)
    # By NumPy: JAX would compile a program for each shape, which takes longer than few runs.
    each = jax.tree.map(lambda x: constant(np.broadcast_to(x, (runs, *np.shape(x)))), shared)
    arrays = (log, carry.tally, carry.fault, carry.excursion, carry.good, each)
    # Made of the first run's numbers, which have the shapes that a run says, and then filled with those of all.
    log, tally, fault, excursion, state, (windows, period, t1) = jax.tree.map(
        lambda x: constant(np.asarray(x)[0, ...]), arrays
    )
    first = Run(
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
        has_envelope=envelope is not None,
    )
    log, tally, fault, excursion, state, (windows, period, t1) = arrays
    leaves = jax.tree.leaves((log, tally, windows, fault, excursion, state, period, t1))
    return jax.tree.unflatten(jax.tree.structure(first), leaves)


def _require_one_length(varied: Any) -> None:
    shapes = [leaf.shape for leaf in jax.tree.leaves(varied)]
    if not shapes or any(not shape for shape in shapes) or len({shape[0] for shape in shapes}) > 1 or not shapes[0][0]:
        raise DefinitionError(
            "`varied` must hold arrays with the run as their first axis, all of one length >= 1; "
            f"got shapes {', '.join(map(str, shapes)) or 'none'}"
        )
