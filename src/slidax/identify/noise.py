"""Covariance of a least-squares fit whose residuals are correlated in time."""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

WIDTH = 30.0
"""Of the window over frequencies, in multiples of the log's own resolution: so many numbers are averaged."""

FRACTION = 0.25
"""Of the cut-off frequency: the window is no wider, since the residuals' spectrum changes over the filter's band."""

LEAST_ROOM = 0.05
"""A share of the degrees of freedom that the fit leaves at least, in a band of frequencies."""


def covariance_of_fit(
    a: np.ndarray, residuals: np.ndarray, counts: np.ndarray, inverse: np.ndarray, rate: float, cut_off: float
) -> np.ndarray:
    """Return `A⁻¹ (Σ_j a_jᵀ R_j a_j) A⁻¹`, with R_j the covariance matrix of joint j's residuals in time, [p p].

    R_j is that of a stationary process with the spectral density of the residuals, so that each residual may be
    correlated with all others. The density is the periodogram averaged over neighbouring frequencies, over the degrees
    of freedom that the fit leaves at them: where the regressor has its power, the fit takes up noise, and the residuals
    are smaller than the noise by the leverage `h_j(ω) = a_j(ω)* A⁻¹ a_j(ω)`.

    The matrix is of full rank, as one from the residuals' sums over blocks is not: with some 40 blocks and some 80
    unknowns such a matrix gives combinations of the unknowns no error at all.

    - `a`: the equations in units of their noise, 0 where they do not count [k n p].
    - `residuals`: in the same units, 0 where they do not count [k n].
    - `counts`: which equations count [k n].
    - `inverse`: A⁻¹ [p p].
    - `rate`: rows per second [Hz].
    - `cut_off`: of the filter that the equations have passed [Hz].
    """
    k = len(a)
    points = fft.next_fast_len(2 * k)
    resolution = rate / k
    window = min(WIDTH * resolution, max(FRACTION * cut_off, resolution))
    width = max(1, round(window * points / rate))

    def averaged(values: np.ndarray) -> np.ndarray:
        once = ndimage.uniform_filter1d(values, width, mode="wrap")
        return ndimage.uniform_filter1d(once, width, mode="wrap")

    total = np.zeros_like(inverse)
    # Real signals: the negative frequencies are the conjugates of the positive ones.
    share = np.full(points // 2 + 1, 2.0 / points)
    share[0] = 1.0 / points
    if points % 2 == 0:
        share[-1] = 1.0 / points
    for joint in range(a.shape[1]):
        used = float(counts[:, joint].sum())
        if not used:
            continue
        columns = fft.rfft(a[:, joint], points, axis=0)
        leverage = np.einsum("wp,wp->w", columns.conj() @ inverse, columns).real
        power = np.abs(fft.rfft(residuals[:, joint], points)) ** 2
        room = np.maximum(used - leverage, LEAST_ROOM * used)
        weighted = averaged(_two_sided(leverage * power, points))
        density = (weighted / averaged(_two_sided(leverage * room, points)))[: len(share)]
        total += ((columns.conj() * (density * share)[:, None]).T @ columns).real
    return inverse @ total @ inverse


def _two_sided(values: np.ndarray, points: int) -> np.ndarray:
    return np.concatenate([values, values[1 : points - len(values) + 1][::-1]])
