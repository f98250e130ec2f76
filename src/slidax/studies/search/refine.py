"""A few quasi-Newton steps where the function is smooth."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from .seen import Seen

STEP = 1e-5
"""Of the differences, in parts of the cube: far above the rounding of a run, far below what bends it."""

TURNS = 10
"""Iterations at most; where the function is not smooth it ends before."""


def refine(evaluated: Seen, start: np.ndarray) -> None:
    """Goes down from a point by L-BFGS-B (R. H. Byrd and others, SIAM J. Sci. Comput. 16, 1995) with differences.

    The points of one gradient are asked for at once. `evaluated` keeps all points.

    - `evaluated`: asks and remembers.
    - `start`: a point of the cube [dimension].
    """

    def value_and_slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        # Inwards, so that all points are in the cube.
        steps = np.where(x < 0.5, STEP, -STEP)
        if evaluated.over or evaluated.left < x.size + 1:
            raise StopIteration
        values = evaluated.ask(np.concatenate([x[None], x + np.diag(steps)]))
        if not np.isfinite(values).all():
            raise StopIteration
        return float(values[0]), (values[1:] - values[0]) / steps

    try:
        minimize(
            value_and_slope,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0)] * start.size,
            options={"maxiter": TURNS, "maxls": 8},
        )
    except StopIteration:
        return
