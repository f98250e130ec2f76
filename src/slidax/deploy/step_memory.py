"""What a guarded step knows of sensors, and keeps from one sample to the next."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, UInt32

from slidax._errors import as_array
from slidax._types import Memory, PerJoint, Scalar, Vector

Status = UInt32[Array, "..."]
"""Bits of `slidax.deploy.status`; 0 if all is well."""

Flag = Bool[Array, ""]


class SensorRange(eqx.Module):
    """What a measurement can be.

    - `q`, `dq`: largest size of a position and of a velocity, one number or [n], rad, rad/s or m, m/s; what is larger
      is taken for a fault of the sensor.
    """

    q: PerJoint = eqx.field(converter=as_array, default=1e6)
    dq: PerJoint = eqx.field(converter=as_array, default=1e6)


class StepMemory(eqx.Module):
    """What the step keeps between two samples.

    - `started`: whether a good measurement has come since the reset.
    - `commanded`: whether a command has been given since then.
    - `t`: time of the last good sample [s].
    - `tau`: the last safe command [n], N m or N; 0 before the first.
    - `law`: what the law keeps.
    """

    started: Flag
    commanded: Flag
    t: Scalar
    tau: Vector
    law: Memory
