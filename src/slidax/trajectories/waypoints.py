"""Waypoints as a person gives them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError


def distinct_waypoints(owner: str, waypoints: object) -> NDArray[np.float64]:
    """The positions [k n], checked.

    - `owner`: whose they are, for the message.
    - `waypoints`: rows of joint positions, at least two, no two in a row the same.

    Raises DefinitionError if they are not.
    """
    try:
        q = np.asarray(waypoints, dtype=float)
    except (TypeError, ValueError):
        raise DefinitionError(f"`{owner}.waypoints` must be rows of numbers, all with one position per joint") from None
    if q.ndim != 2 or len(q) < 2 or q.shape[1] < 1:
        raise DefinitionError(
            f"`{owner}.waypoints` must be two or more rows with one position per joint; got shape {list(q.shape)}"
        )
    if not np.all(np.isfinite(q)):
        row, joint = np.argwhere(~np.isfinite(q))[0]
        raise DefinitionError(f"`{owner}.waypoints` must be finite; waypoint {row + 1} is not, for joint {joint + 1}")
    same = np.all(np.diff(q, axis=0) == 0, axis=1)
    if same.any():
        row = int(np.argmax(same)) + 1
        raise DefinitionError(
            f"`{owner}.waypoints` {row} and {row + 1} are the same, {q[row].tolist()}: leave one of them out "
            "(for a pause give times of your own, with `MinimumJerk.through`)"
        )
    return q
