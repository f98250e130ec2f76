"""Checks of waypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slidax.parts import DefinitionError, shown

MOST_WAYPOINTS = 10_000
"""Waypoints of one motion; what has more is a log, and read from a file."""


def positions(owner: str, waypoints: object) -> NDArray[np.float64]:
    """Return the positions [k n], finite and with equally many joints.

    - `owner`: class of the motion, for the message.

    Raises DefinitionError for anything else.
    """
    if isinstance(waypoints, Sequence) and len(waypoints) > MOST_WAYPOINTS:
        raise DefinitionError(f"`{owner}.waypoints` must be at most {MOST_WAYPOINTS}; got {len(waypoints)}")
    try:
        q = np.asarray(waypoints, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"`{owner}.waypoints` must be rows of numbers, all with one position per joint") from None
    if q.ndim != 2 or len(q) < 2 or q.shape[1] < 1:
        raise DefinitionError(
            f"`{owner}.waypoints` must be two or more rows with one position per joint; got shape {list(q.shape)}"
        )
    if not np.all(np.isfinite(q)):
        row, joint = np.argwhere(~np.isfinite(q))[0]
        raise DefinitionError(f"`{owner}.waypoints` must be finite; waypoint {row + 1} is not, for joint {joint + 1}")
    return q


def distinct_waypoints(owner: str, waypoints: object) -> NDArray[np.float64]:
    """Return the positions [k n]; raise DefinitionError also if two in a row are the same."""
    q = positions(owner, waypoints)
    same = np.all(np.diff(q, axis=0) == 0, axis=1)
    if same.any():
        row = int(np.argmax(same)) + 1
        raise DefinitionError(
            f"`{owner}.waypoints` {row} and {row + 1} are the same, {shown(q[row])}: leave one of them out "
            "(for a pause give times of your own, with `MinimumJerk.through`)"
        )
    return q
