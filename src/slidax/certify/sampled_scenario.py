"""A scenario's reference, true arm and envelope at many times, evaluated by compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.analysis.run_record import inertia_and_bias
from slidax.arms.arm import AbstractRobot
from slidax.codegen import llvm
from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.trace.tracing import trace
from slidax.core.types import Scalar, State
from slidax.law.sampled.controller import SampledData
from slidax.law.sliding_mode_controllers import SlidingMode
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

Floats: TypeAlias = NDArray[np.floating[Any]]
Flags: TypeAlias = NDArray[np.bool_]


@dataclass(eq=False)
class BatchedFunction:
    """A function that is compiled and then evaluated for many arguments at once.

    Native code is preferred, as XLA takes ten times as long to compile.

    - `function`: JAX function from arrays to an array, or a tuple of them.
    """

    function: Callable[..., Any]
    _compiled: Callable[..., list[Any]] | None = field(default=None, init=False)

    def __call__(self, *rows: Any) -> list[Floats]:
        """Return the function's outputs for each row; the first axis of all arguments and outputs is the row."""
        arrays = [np.ascontiguousarray(row, float) for row in rows]
        if self._compiled is None:
            self._compiled = _native(self.function, arrays) or _by_xla(self.function)
        return [np.asarray(output) for output in self._compiled(*arrays)]


def _native(function: Callable[..., Any], arrays: list[Floats]) -> Callable[..., list[Any]] | None:
    if not llvm.available():
        return None
    with suppress(NoNativeCodeError):
        program = trace(function, *(jax.ShapeDtypeStruct(array.shape[1:], float) for array in arrays), named=False)
        program.inputs[:] = [replace(source, varying=True) for source in program.inputs]
        kernel = llvm.compile(program)
        return lambda *rows: list(kernel.batch(list(rows), runs=len(rows[0]), threads=1))
    return None


def _by_xla(function: Callable[..., Any]) -> Callable[..., list[Any]]:
    compiled = eqx.filter_jit(lambda *rows: jax.vmap(function)(*rows))
    return lambda *rows: jax.tree.leaves(compiled(*rows))


SAMPLES = 4001
"""Largest number of samples of a motion."""


@dataclass(frozen=True, eq=False)
class SampledReference:
    """A scenario's reference at sampled times, with the inertia and torques of arms along it.

    The times are spread so that effects that repeat with the period are sampled at all phases.

    - `first`: the first time, s.
    """

    scenario: Scenario
    first: float = 0.0

    @cached_property
    def times(self) -> Floats:
        """Sample times, s."""
        count = min(SAMPLES, round((self.scenario.t1 - self.first) / self.scenario.period) + 1)
        # Steps by the golden ratio are spread evenly over the phases of anything periodic.
        shift = (np.arange(count) * 0.618033988749895) % 1.0
        spread = (np.arange(count) + shift) / max(count, 1)
        return self.first + spread * (self.scenario.t1 - self.first)

    @cached_property
    def states(self) -> tuple[Floats, Floats, Floats]:
        """`q_d`, `q̇_d`, `q̈_d` at the sample times, [times n]."""
        return self.reference(self.times)

    def reference(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return `q_d`, `q̇_d`, `q̈_d` at given times, [times n]."""
        q, dq, ddq = self._reference(times)
        return q, dq, ddq

    @cached_property
    def _reference(self) -> BatchedFunction:
        def at(t: Any) -> Any:
            reference = self.scenario.trajectory.reference(t)
            return reference.q, reference.dq, reference.ddq

        return BatchedFunction(at)

    @cached_property
    def plant(self) -> Plant:
        """The true arm with its payload and external forces."""
        plant = self.scenario.plant
        return plant if isinstance(plant, Plant) else plant.own

    def of_arm(self, robot: AbstractRobot) -> tuple[Floats, Floats]:
        """Return the inertia matrix M [times n n] and the torque `C q̇ + G` [times n] of an arm along the motion."""
        return inertia_and_bias(robot, *self.states[:2])

    @cached_property
    def truth(self) -> tuple[Floats, Floats]:
        """M [times n n], and `C q̇ + G + F` with friction F [times n], of the true arm and its payload on the motion."""
        mass, bias = self.of_arm(self.plant.robot)
        load = self.plant.load
        if load is not None:
            carried = (self.times >= float(load.attached)) & (self.times < float(load.released))
            loaded_mass, loaded_bias = self.of_arm(load.on(self.plant.robot, load.attached))
            mass = np.where(carried[:, None, None], loaded_mass, mass)
            bias = np.where(carried[:, None], loaded_bias, bias)
        return mass, bias + BatchedFunction(self.plant.robot.friction)(self.states[1])[0]

    @cached_property
    def external_torque(self) -> Floats:
        """External torque along the motion [times n], N m or N."""
        disturbance = BatchedFunction(lambda t, q, dq: self.plant.disturbance(t, State(q=q, dq=dq)))
        return disturbance(self.times, *self.states[:2])[0]


def has_envelope(scenario: Scenario) -> bool:
    """Return True if the scenario's law has an envelope of the tracking error."""
    law = scenario.controller
    return eqx.filter_eval_shape(lambda: _envelope_at_rest(scenario, law.joints)) is not None


def envelope_bounds(scenario: Scenario, times: Floats) -> tuple[Floats, Floats] | None:
    """Return the envelope's lower and upper bounds for the scenario's own start [times n], rad or m; None without one.

    - `times`: [times], s.
    """
    if not has_envelope(scenario):
        return None
    law, state0 = scenario.controller, scenario.state0

    def at(t: Any, q: Any, dq: Any) -> Any:
        memory = law.init(jnp.zeros(()), State(q=q, dq=dq), scenario.trajectory.reference(jnp.zeros(())))
        envelope = law.envelope(t, memory)
        assert envelope is not None
        return envelope.lower, envelope.upper

    rows = len(times)
    lower, upper = BatchedFunction(at)(
        times, *(np.broadcast_to(np.asarray(value), (rows, law.joints)) for value in (state0.q, state0.dq))
    )
    return lower, upper


def _envelope_at_rest(scenario: Scenario, joints: int) -> Any:
    t, law = jnp.zeros(()), scenario.controller
    reference = scenario.trajectory.reference(t)
    return law.envelope(t, law.init(t, State(q=jnp.zeros(joints), dq=jnp.zeros(joints)), reference))


def surface_law(scenario: Scenario) -> Any | None:
    """Return the part of the scenario's law that has the transformation, surface, reaching law and torque bound.

    It is the law itself, or the `step` of a law in sampled-data form; None for a law without them.
    """
    law = scenario.controller
    inner = law.step if isinstance(law, SampledData) else law
    return inner if isinstance(law, SlidingMode) or hasattr(inner, "transformation") else None


def envelope_width(scenario: Scenario, t: Floats) -> Floats | None:
    """Return the larger side of the envelope at times `t` [times n], rad or m; None for a scheme without an envelope.

    - `t`: [times], s.
    """
    law, start = scenario.controller, scenario.state0
    zero = jnp.zeros(())
    memory = law.init(zero, start, scenario.trajectory.reference(zero))
    if law.envelope(zero, memory) is None:
        return None

    def side(t: Scalar) -> jax.Array:
        envelope = law.envelope(t, memory)
        assert envelope is not None
        return jnp.maximum(-envelope.lower, envelope.upper)

    width = np.asarray(jax.jit(jax.vmap(side))(jnp.asarray(t)))
    return np.broadcast_to(width, (len(t), law.joints))
