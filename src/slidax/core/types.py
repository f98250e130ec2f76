"""State, reference, envelope, command, array types, and the timing of a control loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .errors import as_array

Scalar = Float[Array, ""]
"""A single number."""

Vector = Float[Array, " n"]
"""One number per joint."""

Matrix = Float[Array, "n n"]
"""A square matrix over the joints."""

PerJoint = Float[Array, "..."]
"""A parameter: one number for all joints (shape []) or one per joint (shape [n])."""

Memory = Any
"""Controller state between two samples: any pytree of arrays, also an empty one."""


def _numbers(value: Any, like: Any = None) -> Any:
    """Convert lists and integers to a float array, and None to zeros shaped like `like`; leave tracers unchanged."""
    if value is None and like is not None:
        return np.zeros(np.shape(like)) if isinstance(like, np.ndarray) else jnp.zeros_like(like)
    if isinstance(value, jax.Array):
        return value if jnp.issubdtype(value.dtype, jnp.inexact) else value.astype(float)
    return as_array(value) if isinstance(value, (list, tuple, float, int, np.ndarray, str)) else value


class State(eqx.Module):
    """Joint positions and velocities. Also used for their time derivatives: `State(q=dq, dq=ddq)`.

    - `q`: positions [n], rad for a revolute joint, m for a prismatic one.
    - `dq`: velocities [n], rad/s or m/s; at rest if not given.

    Raises DefinitionError for a list that contains anything but numbers.
    """

    q: Vector
    dq: Vector

    def __init__(self, q: Any, dq: Any = None) -> None:
        self.q = _numbers(q)
        self.dq = _numbers(dq, self.q)


class Reference(eqx.Module):
    """Reference motion at one time.

    - `q`, `dq`, `ddq`: desired position, velocity and acceleration [n] in rad, rad/s, rad/s² (m for a prismatic joint);
      at rest if only the position is given.

    Raises DefinitionError for a list that contains anything but numbers.
    """

    q: Vector
    dq: Vector
    ddq: Vector

    def __init__(self, q: Any, dq: Any = None, ddq: Any = None) -> None:
        self.q = _numbers(q)
        self.dq = _numbers(dq, self.q)
        self.ddq = _numbers(ddq, self.q)


class Envelope(eqx.Module):
    """Bounds of the tracking error e at one time: `lower < e < upper`, eq. (12) of doi 10.1007/s11071-022-07650-w.

    - `lower`, `upper`: bounds of e [n], rad or m.
    """

    lower: Vector
    upper: Vector


class Command(eqx.Module):
    """Controller output at one sample.

    - `tau`: joint torques [n], N m (N for a prismatic joint).
    - `memory`: the controller's memory after this sample, with the tree structure of the memory before it.
    - `signals`: internal quantities by name (`s`, `eps1`, `u`, ...), for plots and logs.
    - `rate`: time derivative of a memory that follows a differential equation, such as an adaptive gain; a tree like
      `memory`. A simulation integrates it: over a period in held mode (one torque per sample), together with the
      plant in continuous mode. None for other memories.
    """

    tau: Vector
    memory: Memory
    signals: dict[str, Float[Array, "..."]]
    rate: Memory = None

    def memory_after(self, period: Scalar) -> Memory:
        """Return the memory at the next sample: `memory + h rate` (Euler), or `memory` if there is no rate.

        - `period`: h [s].
        """
        if self.rate is None:
            return self.memory
        return jax.tree.map(lambda m, dm: m + period * dm, self.memory, self.rate)


@dataclass(frozen=True)
class Timing:
    """Sample time of a control loop, and the delays in it.

    - `period`: time between two samples [s].
    - `delay`: measurement delay, the age of a measurement when it arrives [periods].
    - `dead_time`: time between a command and its torque [periods].
    """

    period: float
    delay: float
    dead_time: float

    @property
    def total_delay(self) -> float:
        """Age of a measurement when its torque acts [periods]."""
        return self.delay + self.dead_time

    @property
    def whole_periods(self) -> int:
        """The total delay, rounded to whole periods."""
        return round(self.total_delay)
