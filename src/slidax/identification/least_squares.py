"""Weighted least squares with standard errors that know that the residuals are correlated."""

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

    Each joint's weight is the inverse of its residuals' variance. The covariance is `A⁻¹ B A⁻¹`, where B adds up the
    products of the residuals' scores over the times that they are correlated for (Newey and West, 1987), with a kernel
    that is flat up to half of its width (Politis and Romano, 1995).

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
    scores = np.einsum("kip,ki->kp", a, off / np.where(sigma > 0, sigma, 1.0))
    share = _freedom(a, data, believed)
    middle = long_run(scores) * share
    inverse = cho_solve(factor, np.eye(len(solved)))
    covariance = inverse @ (middle + np.diag(believed)) @ inverse
    # So that the residuals' correlation weighs in against what was believed, too.
    ratio = max(1.0, float(np.trace(np.linalg.lstsq(data + np.diag(believed), middle, rcond=None)[0]) / len(solved)))
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


def long_run(scores: np.ndarray) -> np.ndarray:
    """The covariance of the sum of correlated scores [p p], which is positive semi-definite.

    - `scores`: over time [k p].
    """
    k = len(scores)
    width = max(8, int(2 * k ** (1 / 3)))
    total = scores.T @ scores
    for late in range(1, min(width, k - 1)):
        kernel = min(1.0, 2.0 * (1.0 - late / width))
        both = scores[late:].T @ scores[:-late]
        total += kernel * (both + both.T)
    unit = np.sqrt(np.maximum(np.diag(scores.T @ scores), 1e-300))
    values, vectors = np.linalg.eigh(total / np.outer(unit, unit))
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    positive: np.ndarray = (half @ half.T) * np.outer(unit, unit)
    return positive


def _freedom(a: np.ndarray, data: np.ndarray, believed: np.ndarray) -> float:
    """By how much residuals are smaller than the noise, as some of it was fitted."""
    fitted = float(np.trace(np.linalg.solve(data + np.diag(believed), data)))
    equations = float((np.abs(a).sum(axis=2) > 0).sum())
    return equations / max(equations - fitted, 0.1 * equations)
