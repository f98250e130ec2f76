"""Checks of a table's motion: velocity jumps, limits, and likely mistakes in its units."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from slidax._errors import DefinitionError, DefinitionWarning

from .motion_limits import MotionLimits, called
from .piecewise_polynomial import AbstractPiecewisePolynomial
from .table import Table
from .velocity_jumps import LEAST, velocity_jump

NO_ARM = 200.0
"""Acceleration beyond any arm, rad/s² or m/s²: a table with more has a jump."""

RESTING = 1e-6
"""Velocities at the ends of a table up to this, rad/s or m/s, are the rounding of a file."""

DENSE, SLOW = 20, 0.02
"""A table with this many rows, whose joints all stay below 0.02 rad/s, probably has another unit of time."""

TWO_TURNS = 4 * np.pi
"""Positions beyond two turns [rad] are rare for an arm and common for degrees."""


def at_rest_outside(table: Table) -> Table:
    """Return the table with velocities of exactly zero at its ends, if it has any.

    Raises DefinitionError, with joint, time, value and remedy, if they are not zero there.
    """
    if table.velocities is None:
        return table
    for row, end, side in ((0, "start", "before"), (len(table.times) - 1, "end", "after")):
        moving = np.abs(table.velocities[row])
        if np.any(moving > RESTING):
            joint = int(np.argmax(moving))
            raise DefinitionError(
                f"{table.at(row)}: {called(joint, table.joints)} has a velocity of {table.velocities[row, joint]:g} "
                f"rad/s (or m/s) at its {end}, t = {table.times[row]:g} s, but it stands still {side} that, so that "
                "the velocity would jump: make it 0 there, or add rows in which the joint comes to rest"
            )
    velocities = table.velocities.copy()
    velocities[[0, -1]] = 0.0
    return replace(table, velocities=velocities)


def require_no_jump(motion: AbstractPiecewisePolynomial, table: Table) -> None:
    """Raise DefinitionError, with joint, time, value and remedy, if a table without velocities jumps."""
    jump = None if table.velocities is not None else velocity_jump(table.times, table.positions)
    if jump is None:
        return
    row = jump.row if jump.end < 1 else jump.row + 1
    where = {-1: "at its start, ", 0: "", 1: "at its end, "}[jump.end]
    needed = motion.extremes(2).size[jump.joint]
    raise DefinitionError(
        f"{table.at(row)}: the velocity of {called(jump.joint, table.joints)} jumps {where}t = {table.times[row]:g} s, "
        f"from {jump.before:.3g} to {jump.after:.3g} rad/s (or m/s) within one row: add rows in which it changes, give "
        "velocities too, or leave the times to `MinimumJerk.within`; or, if the arm can do "
        f"{np.ceil(needed):.4g} rad/s² (or m/s²), say so with `acceleration`"
    )


def warn_of_slow_times(motion: AbstractPiecewisePolynomial, table: Table) -> None:
    """Warn if, by spacing and speed, times of an unknown unit may not be in seconds."""
    spacing = float(np.median(np.diff(table.times)))
    fastest = float(motion.extremes(1).size.max())
    if table.unit_is_known or len(table.times) < DENSE or spacing < 0.5 or not 0.0 < fastest < SLOW:
        return
    unit = next(unit for unit, factor in (("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3)) if spacing * factor > 1e-4)
    warnings.warn(
        DefinitionWarning(
            f"{table.source} has {len(table.times)} rows, {spacing:.4g} s apart, and no joint moves faster than "
            f"{fastest:.2g} rad/s (or m/s): are the times in {unit}? Then set `time_unit` to {unit}, otherwise to s"
        ),
        stacklevel=3,
    )


def require_within(motion: AbstractPiecewisePolynomial, table: Table, limits: MotionLimits) -> None:
    """Raise DefinitionError, with the likely cause, if the motion passes a limit."""
    largest = float(np.abs(table.positions).max())
    degrees = f"; positions go to {largest:.4g}: are they degrees? They must be rad or m" if largest > TWO_TURNS else ""
    limits.require(motion, table.source, table.joints, degrees, degrees or _about_rates(table))


def _about_rates(table: Table) -> str:
    """Likely mistake in velocities or times."""
    rates = np.abs(np.diff(table.positions, axis=0) / np.diff(table.times)[:, None])
    if table.velocities is not None:
        mean_speed = float(np.abs((table.velocities[1:] + table.velocities[:-1]) / 2).mean())
        implied = float(rates.mean())
        if min(mean_speed, implied) > LEAST and not 0.1 * implied <= mean_speed <= 10 * implied:
            return (
                f"; the velocities are {mean_speed / implied:.3g} times what positions and times say: are they in "
                "rad/s or m/s?"
            )
    row = int(np.argmax(rates.max(axis=1)))
    return (
        f"; the fastest rows are {table.rows[row]} and {table.rows[row + 1]}, "
        f"{table.times[row + 1] - table.times[row]:.3g} s apart: is there a step in the table, or a time too short?"
    )
