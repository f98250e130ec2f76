"""The quintic spline at rest at both ends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def quintic_spline(times: NDArray[np.float64], waypoints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients through waypoints [k n], highest power of `t - times[i]` first, [6 k-1 n]."""
    from scipy.interpolate import make_interp_spline

    rest = np.zeros(waypoints.shape[1])
    ends = [(1, rest), (2, rest)]
    # Solved on [0, 1]: with the times themselves the fifth-degree basis is ill-conditioned for long motions.
    span = times[-1] - times[0]
    z = (times - times[0]) / span
    spline = make_interp_spline(z, waypoints, k=5, bc_type=(ends, ends))
    # The Taylor coefficients at the left end of each piece, where the spline and its derivatives are exact.
    return np.stack([spline(z[:-1], nu=i) / (math.factorial(i) * span**i) for i in reversed(range(6))])
