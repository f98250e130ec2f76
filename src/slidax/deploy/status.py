"""What a step says beside its torque: bits, each with what it means and what to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Condition:
    """One bit of the status.

    - `name`: as in C, without its prefix.
    - `bit`: its value, a power of two.
    - `meaning`: when it is set.
    - `held`: whether the command is then the last safe one, and the memory unchanged.
    - `remedy`: what to do about it.
    """

    name: str
    bit: int
    meaning: str
    held: bool
    remedy: str


MEASUREMENT_NOT_FINITE = Condition(
    "MEASUREMENT_NOT_FINITE",
    1,
    "a measured number is NaN or infinite",
    True,
    "One sample is bridged by itself. If it lasts, the sensor is gone: brake.",
)
MEASUREMENT_OUT_OF_RANGE = Condition(
    "MEASUREMENT_OUT_OF_RANGE",
    2,
    "a position or velocity is larger than `range_q` or `range_dq`, more than the sensor can mean",
    True,
    "As above. Set the ranges to what your arm can do.",
)
REFERENCE_NOT_FINITE = Condition(
    "REFERENCE_NOT_FINITE",
    4,
    "the reference is NaN or infinite",
    True,
    "A fault of the planner: brake.",
)
TORQUE_NOT_FINITE = Condition(
    "TORQUE_NOT_FINITE",
    8,
    "the law has no finite answer there, or would remember none",
    True,
    "With ENVELOPE_LEFT: the law is not defined outside. Brake, then reset. Alone: look for an absurd gain.",
)
ENVELOPE_LEFT = Condition(
    "ENVELOPE_LEFT",
    16,
    "a joint's error is at or outside its envelope; the command stands if the law has one",
    False,
    "A sampled-data law comes back by itself. For any other: brake, then reset, which draws the envelope anew.",
)
TORQUE_LIMITED = Condition(
    "TORQUE_LIMITED",
    32,
    "the law wanted more than the limits of torque or of its rate allow",
    False,
    "Harmless for a while. If it lasts, the motion asks for more than the drives have.",
)
MISSED_PERIOD = Condition(
    "MISSED_PERIOD",
    64,
    "the time is more than 1.5 periods after that of the last good sample, or not after it",
    False,
    "Samples were lost, or the loop was late. Once is harmless; look at the loop if it is not rare.",
)

PROMISE_VOID = Condition(
    "PROMISE_VOID",
    128,
    "the law's monitor says that what the envelope's promise was computed for is not so; never set without a monitor",
    False,
    "The envelope may soon be left: slow down or brake. `assumption_violated` says what is not as it should be.",
)

CHECKED = (MEASUREMENT_NOT_FINITE, MEASUREMENT_OUT_OF_RANGE, REFERENCE_NOT_FINITE)
"""What can be wrong with a sample."""

ANSWERED = (TORQUE_NOT_FINITE, ENVELOPE_LEFT, TORQUE_LIMITED, MISSED_PERIOD, PROMISE_VOID)
"""What can be said of the answer to a good one."""

CONDITIONS = (*CHECKED, *ANSWERED)
"""All of them, by their bits."""

HELD = sum(condition.bit for condition in CONDITIONS if condition.held)
"""The bits with which the command is the last safe one."""
