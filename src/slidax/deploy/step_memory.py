"""Memory of a guarded step between two samples."""

from __future__ import annotations

import equinox as eqx
from jaxtyping import Array, Bool, UInt32

from slidax._types import Memory, Scalar, Vector
from slidax.controllers import GateMemory

Status = UInt32[Array, "..."]
"""Bits of a `Condition`; 0 if all is well."""

Flag = Bool[Array, ""]


class StepMemory(eqx.Module):
    """Memory of the step between two samples.

    - `started`: True once a good measurement has arrived after the reset.
    - `commanded`: True once a command has been given after the reset, also the 0 of a bad sample.
    - `t`: time stamp of the last good sample [s].
    - `tau`: the last safe command [n], N m or N; 0 before the first.
    - `held`: consecutive steps whose command was held.
    - `stop`: True once the step has requested a stop; stays so until the reset.
    - `outside`: time for which a joint has been outside the envelope without a break [s].
    - `law`: memory of the law.
    - `gate`: memory of the gate; None for a sampled-data law, which has its own.
    """

    started: Flag
    commanded: Flag
    t: Scalar
    tau: Vector
    held: Scalar
    stop: Flag
    outside: Scalar
    law: Memory
    gate: GateMemory | None
