"""Status bits of a guarded step, and the memory that the step keeps between samples."""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
from jaxtyping import Array, Bool, UInt32

from slidax.core.types import Memory, Scalar, Vector
from slidax.law.sampled.gate import GateMemory


@dataclass(frozen=True)
class Condition:
    """One bit of the status.

    - `name`: its name in C, without the prefix.
    - `bit`: its value, a power of two.
    - `meaning`: the condition that sets it.
    - `held`: True if the step then repeats the last safe command and does not change the law's memory, except that of
      the measurement gate.
    - `remedy`: advice to the user.
    """

    name: str
    bit: int
    meaning: str
    held: bool
    remedy: str


MEASUREMENT_NOT_FINITE = Condition(
    "MEASUREMENT_NOT_FINITE",
    1,
    "the time or a measured number is NaN or infinite",
    True,
    "The step bridges a single sample. If it lasts, the sensor has failed: brake.",
)
MEASUREMENT_OUT_OF_RANGE = Condition(
    "MEASUREMENT_OUT_OF_RANGE",
    2,
    "a measured position is beyond `gate_q_max`",
    True,
    "If it lasts, brake. `gate_q_max` is 1.5 times the arm's position limits by default; enlarge it if necessary.",
)
REFERENCE_NOT_FINITE = Condition(
    "REFERENCE_NOT_FINITE",
    4,
    "the reference is NaN or infinite",
    True,
    "The planner has a fault: brake.",
)
TORQUE_NOT_FINITE = Condition(
    "TORQUE_NOT_FINITE",
    8,
    "the law's torque or its memory is not finite",
    True,
    "With ENVELOPE_LEFT: the law is not defined outside its envelope; brake, then reset. Alone: check the gains.",
)
ENVELOPE_LEFT = Condition(
    "ENVELOPE_LEFT",
    16,
    "a joint's error is at or outside its envelope; the law's command, if it is finite, is still sent",
    False,
    "A sampled-data law returns to its envelope. For any other law: brake, then reset, which starts a new envelope.",
)
TORQUE_LIMITED = Condition(
    "TORQUE_LIMITED",
    32,
    "the law's torque exceeded the limits of torque or of its rate",
    False,
    "Harmless for a while. If it lasts, the motion needs more torque than the drives have.",
)
MISSED_PERIOD = Condition(
    "MISSED_PERIOD",
    64,
    "the time is more than 1.5 periods after that of the last good sample, or not after it",
    False,
    "Samples were lost, or the loop was delayed. A single one is harmless; check the loop if it is not rare.",
)

PROMISE_VOID = Condition(
    "PROMISE_VOID",
    128,
    "the law's monitor reports a violated assumption of the envelope's guarantee; never set without a monitor",
    False,
    "The error may soon leave its envelope: slow down or brake. `assumption_violated` names the assumption.",
)

MEASUREMENT_REJECTED = Condition(
    "MEASUREMENT_REJECTED",
    256,
    "the arm cannot have moved from the last accepted measurement to this one in the time between them, the positions "
    "are frozen, or the time stamp is not after the last one; the sample is treated as a lost one",
    True,
    "One such sample is harmless. If they repeat, look at the encoder, its cable, its sampling rate and the clock.",
)

STOP_REQUESTED = Condition(
    "STOP_REQUESTED",
    512,
    "`gate_patience` steps in a row have held their command; stays set until the reset",
    False,
    "Brake now. The law does not know the arm's position.",
)

RECOVERY_OVERDUE = Condition(
    "RECOVERY_OVERDUE",
    1024,
    "a joint has been outside its envelope for longer than the envelope takes to settle",
    False,
    "The drives are too weak for the disturbance or the motion: slow down or brake.",
)

PARAMETERS_INVALID = Condition(
    "PARAMETERS_INVALID",
    2048,
    "a parameter is not finite, or is outside the range in its comment; only in C",
    True,
    "Correct the parameter. `parameters_valid` checks it before a step.",
)

CHECKED = (MEASUREMENT_NOT_FINITE, MEASUREMENT_OUT_OF_RANGE, REFERENCE_NOT_FINITE)
"""Conditions of a sample that are checked before the law runs."""

ANSWERED = (
    TORQUE_NOT_FINITE,
    ENVELOPE_LEFT,
    TORQUE_LIMITED,
    MISSED_PERIOD,
    PROMISE_VOID,
    MEASUREMENT_REJECTED,
    STOP_REQUESTED,
    RECOVERY_OVERDUE,
)
"""Conditions that a step can report after the law has run."""

WAITING = (STOP_REQUESTED,)
"""Conditions that a step with a held command can report in addition to those of the bad sample."""

CONDITIONS = (*CHECKED, *ANSWERED, PARAMETERS_INVALID)
"""All conditions, in the order of their bits."""

HELD = sum(condition.bit for condition in CONDITIONS if condition.held)
"""All status bits with which the step holds the last safe command."""


Status = UInt32[Array, "..."]
"""Status: the sum of the bits of all conditions that hold; 0 if there is none."""

Flag = Bool[Array, ""]


class StepMemory(eqx.Module):
    """Memory of a guarded step between two samples.

    - `started`: True once a good measurement has arrived after the reset.
    - `commanded`: True once a step has returned a command after the reset, even if it is the 0 of a bad sample.
    - `t`: time stamp of the last good sample [s].
    - `tau`: the last safe command [n], N m or N. Before the first it is 0, or the nominal arm's torque `C0 q̇ + G0` once
      the law has started.
    - `held`: number of consecutive steps whose command was held.
    - `stop`: True once the step has requested a stop; stays so until the reset.
    - `outside`: time for which a joint has been outside the envelope without interruption [s].
    - `law`: memory of the law.
    - `gate`: memory of the gate, the plausibility check of measurements; None for a sampled-data law, which has its
      own gate.
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
