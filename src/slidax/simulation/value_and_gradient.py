"""A number of a run, and its gradient by the gains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from slidax._errors import DefinitionError, as_array
from slidax._types import Scalar
from slidax.codegen import NoNativeCodeError

from . import native_engine
from .define import windows_of
from .duals import Dual, pushed
from .engine import engine_for, say_xla_instead
from .run import Run
from .simulate import BANDS
from .simulate_batch import Parts, Task
from .stepping import Stepping


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
    """`J(x)` and `dJ/dx` for `J(x) = metric(simulate(*define(x)))`, in forward mode.

    The run and its derivatives in the directions of all numbers of x go forward through time together, eight
    directions side by side. That is the way for up to some dozens of numbers: it keeps nothing of the run, and its
    code is made in seconds. `jax.grad` of `simulate` takes the time of a few runs for however many numbers, but keeps
    every state, and for an arm of seven joints XLA compiles it for minutes.

    - `metric`: from a run to one number; pure, as inside `jax.grad`: `run.log.valid` marks what is good.
    - `define`: from x to `(plant, controller, trajectory, state0)`; pure, and traced by JAX.
    - `at`: x, a tree of numbers and arrays.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`; the engine "xla" is `jax.jvp` of it.
    - `log_every`: one in how many samples is logged, for the metric to read; None logs none.

    Returns J, and a tree like `at`.

    Raises DefinitionError if `at` holds no numbers, or the parts do not fit each other.
    """
    at = jax.tree.map(as_array, at)
    numbers, rebuilt = ravel_pytree(at)
    if not numbers.size:
        raise DefinitionError("`at` must hold the numbers by which to differentiate; it holds none")
    directions = jax.vmap(rebuilt)(jnp.eye(numbers.size))
    task = Task(define, float(t1), Stepping.of(stepping, changes), log_every, tuple(bands))
    engine = task.stepping.engine
    if engine_for(engine) == "native":
        try:
            value, slopes = _natively(metric, task, at, directions)
            return value, rebuilt(slopes)
        except NoNativeCodeError as error:
            if engine == "native":
                raise
            say_xla_instead(f"there is {error.message}")

    def by_xla(at: Any, directions: Any) -> tuple[Scalar, Any]:
        many: Any = jax.vmap(lambda v: jax.jvp(lambda x: metric(task.simulated(x)), (at,), (v,)), out_axes=(None, 0))
        return many(directions)

    value, slopes = jax.jit(by_xla)(at, directions)
    return value, rebuilt(slopes)


def _natively(metric: Callable[[Run], Scalar], task: Task, at: Any, directions: Any) -> tuple[Scalar, Any]:
    *_, samples, (units, names) = eqx.filter_eval_shape(task.loop, at)
    (carry, envelope, *_), log = native_engine.drive_duals(
        task, lambda at: task.loop(at)[:2], at, directions, samples, task.log_every
    )
    windows = windows_of(samples - 1, task.stepping.period, task.bands)
    period, t1 = jnp.asarray(task.stepping.period, float), jnp.asarray(task.t1)

    def run_of(parts: tuple[Any, ...]) -> Run:
        log, tally, fault, excursion, state = parts
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
            has_envelope=envelope is not None,
        )

    log = Dual(None, None) if log is None else log
    # The run itself is the same in all directions.
    value, tangent = (
        (lines, end.tally, end.fault, end.excursion, end.good)
        for lines, end in ((log.value, carry.value), (log.tangent, carry.tangent))
    )
    value = jax.tree.map(lambda x: x[0], value)
    results, slopes = jax.vmap(lambda v: pushed(lambda parts: metric(run_of(parts)), value, v), out_axes=(None, 0))(
        jax.tree.map(jnp.asarray, tangent)
    )
    return results, slopes
