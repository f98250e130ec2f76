"""Weighted least squares, with standard errors that hold for correlated residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from .signals import Signals
from .unknowns import Unknowns

PER_CUT_OFF = 3.0
"""Rows that are kept per period of the cut-off frequency: between them nothing new is to be seen."""

ROUNDS = 4
"""Times that the weights are found anew from the residuals."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The parameters that fit best, and how well they are known.

    - `theta`: [p].
    - `covariance`: of their errors [p p].
    - `information`: of data and of what was believed before [p p].
    - `gain`: eigenvalues of the data's information over that of what was believed before [p], largest first.
    - `lag`, `lag_error`: by how much the torques come after the positions, and its standard error [s].
    - `sigma`: standard deviation of the residuals [n].
    """

    theta: np.ndarray
    covariance: np.ndarray
    information: np.ndarray
    gain: np.ndarray
    lag: float
    lag_error: float
    sigma: np.ndarray


def fit(unknowns: Unknowns, signals: Signals, rows: slice) -> Fit:
    """Weighted least squares on the filtered equation, with a time by which torques lag as one more unknown.

    Each joint's weight is the inverse of its residuals' variance. The covariance is that of `jackknife`, and what the
    belief adds to it.

    - `unknowns`: the equation.
    - `signals`: of the log.
    - `rows`: the part of the log that is fitted.
    """
    columns = signals.filtered(unknowns.columns[rows])
    target = signals.filtered((signals.tau - unknowns.known)[rows])
    known = signals.filtered(unknowns.known[rows])
    counts = unknowns.counts[rows].copy()
    counts[: signals.settled] = counts[len(counts) - signals.settled :] = False
    every = max(1, int(signals.rate / (PER_CUT_OFF * signals.cut_off)))
    theta, lag = unknowns.prior.copy(), 0.0
    sigma = np.maximum(np.std(target, axis=0), 1e-12)
    believed = 1.0 / np.append(unknowns.scale, LAG_SCALE) ** 2
    for _ in range(ROUNDS):
        moved = np.gradient(known + columns @ theta, 1.0 / signals.rate, axis=0)
        x = np.concatenate([columns, -moved[:, :, None]], axis=2)[::every]
        y, used = target[::every], counts[::every]
        weight = used / sigma
        a, b = x * weight[:, :, None], y * weight
        data = np.einsum("kip,kiq->pq", a, a)
        start = np.append(unknowns.prior, 0.0)
        factor = cho_factor(data + np.diag(believed))
        solved = start + cho_solve(factor, np.einsum("kip,ki->p", a, b - a @ start))
        theta, lag = solved[:-1], float(solved[-1])
        off = (y - x @ solved) * used
        size = np.maximum(used.sum(axis=0), 1)
        sigma = np.maximum(np.sqrt((off**2).sum(axis=0) / size), 1e-6 * np.std(target, axis=0) + 1e-12)
    whole = data + np.diag(believed)
    covariance = jackknife(whole, a, off / sigma) + np.linalg.inv(whole) @ np.diag(believed) @ np.linalg.inv(whole)
    # By how much fewer samples there seem to be, as residuals are correlated; so that it counts against what was
    # believed, too.
    ratio = max(1.0, float(np.trace(whole @ covariance)) / len(solved))
    information = data / ratio + np.diag(believed)
    scale = np.append(unknowns.scale, LAG_SCALE)
    gain = np.linalg.eigvalsh((data / ratio) * np.outer(scale, scale))[::-1]
    return Fit(
        theta=theta,
        covariance=covariance[:-1, :-1],
        information=information[:-1, :-1] - np.outer(information[:-1, -1], information[-1, :-1]) / information[-1, -1],
        gain=np.maximum(gain, 0.0),
        lag=lag,
        lag_error=float(np.sqrt(covariance[-1, -1])),
        sigma=sigma,
    )


LAG_SCALE = 0.01
"""How far torques may be believed to lag, s."""


def jackknife(whole: np.ndarray, a: np.ndarray, off: np.ndarray) -> np.ndarray:
    """The covariance of a least-squares fit, from what it becomes without one block of the log after another [p p].

    Within a block residuals may be correlated as they like. Blocks that weigh much in the fit count as much more as
    their residuals are small because of that, which sums over the residuals miss: with these some 10 % of the standard
    errors, where the unknowns take up much of the noise in the motion's own band. For linear least squares each is
    `θ - θ_b = (A - A_b)⁻¹ a_bᵀ r_b` (Shao and Wu, *Heteroscedasticity-robustness of jackknife variance estimators in
    linear models*, 1987).

    - `whole`: A, of data and of what was believed before [p p].
    - `a`: the equations in units of their noise [k n p].
    - `off`: the residuals in the same units [k n].
    """
    k = len(a)
    rows = max(8, int(2 * k ** (1 / 3)))
    blocks = max(2, k // rows)
    total = np.zeros_like(whole)
    for block in np.array_split(np.arange(k), blocks):
        own = a[block].reshape(-1, a.shape[2])
        change = np.linalg.solve(whole - own.T @ own, own.T @ off[block].reshape(-1))
        total += np.outer(change, change)
    return (blocks - 1) / blocks * total
