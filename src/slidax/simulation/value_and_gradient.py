"""A metric of a run, and its gradient with respect to gains."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from slidax._errors import DefinitionError, as_array
from slidax._types import Scalar

from . import native_engine
from .duals import Dual, jvp
from .engine import engine_for, native_or_xla
from .run import Run
from .simulate import BANDS
from .simulate_batch import BatchRequest, Parts, results_of, run_of
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
    """Return `J(x)` and `dJ/dx`, a tree like x, for `J(x) = metric(simulate(*define(x)))`, in forward mode.

    The run and its derivatives in all directions of x advance together, eight directions side by side. This suits up
    to some dozens of parameters: it stores no states, and compiles in seconds. `jax.grad` of `simulate` takes the time
    of a few runs for any number of parameters, but stores every state, and XLA compiles it for minutes for an arm with
    seven joints.

    - `metric`: maps a run to one number; pure, as inside `jax.grad`. `run.log.valid` marks the valid samples.
    - `define`: maps x to `(plant, controller, trajectory, state0)`; pure, and traced by JAX.
    - `at`: x, a tree of numbers and arrays.
    - `t1`, `stepping`, `bands`, `changes`: as in `simulate`; the engine "xla" is its `jax.jvp`.
    - `log_every`: log one in so many samples for the metric; None logs none.

    Raises DefinitionError if `at` holds no numbers, or the parts do not fit each other.
    """
    at = jax.tree.map(as_array, at)
    numbers, rebuilt = ravel_pytree(at)
    if not numbers.size:
        raise DefinitionError("`at` must hold the numbers by which to differentiate; it holds none")
    directions = jax.vmap(rebuilt)(jnp.eye(numbers.size))
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
    return value, rebuilt(slopes)


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
    # The run itself is the same in all directions.
    value = jax.tree.map(lambda x: x[0], (log.value, *results_of(carry.value)))
    tangent = jax.tree.map(jnp.asarray, (log.tangent, *results_of(carry.tangent)))
    return jax.vmap(lambda v: jvp(metric_of, value, v), out_axes=(None, 0))(tangent)
