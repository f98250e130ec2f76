"""Reasons for which an arm comes to rest or its control stops."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """A reason.

    - `name`: as in C, without its prefix.
    - `stops`: True if the control ends at once; otherwise the arm comes to rest along its path.
    """

    name: str
    meaning: str
    stops: bool
    remedy: str


REASONS = (
    Reason("NONE", "nothing is wrong", False, "The motion is over."),
    Reason("ASKED", "an end was asked for", False, "Nothing is wrong."),
    Reason(
        "NOT_BEGUN",
        "it has not begun: an option or the posture makes no sense",
        True,
        "Look at the options; a posture that is not finite is a sensor's fault.",
    ),
    Reason("NO_MEASUREMENT", "no good measurement for too long", True, "The sensor or the link to it is gone."),
    Reason("NO_REFERENCE", "no finite reference for too long", True, "A fault of the planner."),
    Reason("NO_TORQUE", "the law has had no finite answer for too long", True, "Look for an absurd gain."),
    Reason(
        "LOST", "too many periods without a sample", True, "Look at the network and at what else the computer does."
    ),
    Reason(
        "ERROR_HOLDING",
        "the error is too large while the arm should hold its posture",
        True,
        "Joints in another order or sign, weight that nobody carries, or somebody who pushes.",
    ),
    Reason(
        "TORQUE_HOLDING",
        "it takes too much torque to hold a posture whose weight the robot carries",
        True,
        "Gravity counted twice, or a load that the robot was not told.",
    ),
    Reason(
        "ERROR_MOVING",
        "the error is too large",
        True,
        "A collision, a model that is far off, or limits too tight for the motion.",
    ),
    Reason(
        "REFERENCE_OUTSIDE",
        "the reference leaves the joints' range or speed",
        True,
        "The motion is not one for this arm: make it smaller or slower.",
    ),
    Reason("POSITION_LIMIT", "a joint is beyond its range", True, "Move it back by hand, and look at the motion."),
    Reason("SPEED_LIMIT", "a joint is faster than it may be", True, "Look at the log: who pushed it?"),
    Reason(
        "OUTSIDE",
        "the law has been outside its envelope for too long",
        False,
        "Look at the log, and let `slidax explain` tell of a run like it; a wider one is `scheme.performance.final`.",
    ),
    Reason(
        "LIMITED",
        "the torque has been at its limits for too long",
        False,
        "The motion asks for more than the drives have: slow it down, or tell the robot its load.",
    ),
    Reason("VOID", "the law's promise has been void for too long", False, "`assumption_violated` says what is not so."),
)
"""All of them, by their numbers."""
