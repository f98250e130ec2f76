"""Weighted least squares, with standard errors that hold for correlated residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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

    - `rows`: the part of the log that is fitted.
    """
    part = signals.part(rows)
    # In units of what was believed before, the belief is the identity.
    columns = part.filtered(unknowns.columns[rows] * unknowns.scale)
    target = part.filtered((signals.tau - unknowns.known)[rows])
    known = part.filtered(unknowns.known[rows])
    counts = unknowns.counts[rows] & part.inner[:, None]
    every = max(1, int(part.rate / (PER_CUT_OFF * part.cut_off)))
    start = np.append(unknowns.prior / unknowns.scale, 0.0)
    solved = start.copy()
    sigma = np.maximum(np.std(target, axis=0), 1e-12)
    for _ in range(ROUNDS):
        moved = part.slope(known + columns @ solved[:-1])
        x = np.concatenate([columns, -LAG_SCALE * moved[:, :, None]], axis=2)[::every]
        y, used = target[::every], counts[::every]
        weight = used / sigma
        a, b = x * weight[:, :, None], y * weight
        solved = start + _solve_regularised(a.reshape(-1, len(start)), (b - a @ start).ravel())
        off = (y - x @ solved) * used
        size = np.maximum(used.sum(axis=0), 1)
        sigma = np.maximum(np.sqrt((off**2).sum(axis=0) / size), 1e-6 * np.std(target, axis=0) + 1e-12)
    data = np.einsum("kip,kiq->pq", a, a)
    identity = np.eye(len(start))
    inverse = _inverse(data + identity)
    covariance = jackknife(data, a, off / sigma) + inverse @ inverse
    # By how much fewer samples there seem to be, as residuals are correlated; so that it counts against what was
    # believed, too.
    ratio = max(1.0, float(np.einsum("ij,ji->", data + identity, covariance)) / len(start))
    information = data / ratio + identity
    gain = np.linalg.eigvalsh(data / ratio)[::-1]
    without_lag = information[:-1, :-1] - np.outer(information[:-1, -1], information[-1, :-1]) / information[-1, -1]
    values, vectors = np.linalg.eigh(without_lag)
    alone = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return Fit(
        theta=solved[:-1] * unknowns.scale,
        covariance=covariance[:-1, :-1] * np.outer(unknowns.scale, unknowns.scale),
        information=alone / np.outer(unknowns.scale, unknowns.scale),
        gain=np.maximum(gain, 0.0),
        lag=float(solved[-1]) * LAG_SCALE,
        lag_error=float(np.sqrt(covariance[-1, -1])) * LAG_SCALE,
        sigma=sigma,
    )


LAG_SCALE = 0.01
"""Prior standard deviation of the torques' lag [s]."""


def _solve_regularised(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The least `|a x - b|² + |x|²`: by orthogonal factors, which no log makes singular."""
    factor = np.linalg.qr(np.column_stack([a, b]), mode="r")
    u, s, vt = np.linalg.svd(factor[:, :-1], full_matrices=False)
    return vt.T @ (s / (s**2 + 1.0) * (u.T @ factor[:, -1]))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """The inverse of a symmetric matrix whose eigenvalues are at least 1, but for rounding."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors / np.maximum(values, 1.0)) @ vectors.T


def jackknife(data: np.ndarray, a: np.ndarray, off: np.ndarray) -> np.ndarray:
    """The covariance of a least-squares fit, from its changes without one block of the log after another [p p].

    Within a block residuals may be correlated as they like. Blocks that weigh much in the fit count as much more as
    their residuals are small because of that, which sums over the residuals miss: with these some 10 % of the standard
    errors, where the unknowns take up much of the noise in the motion's own band. For linear least squares each is
    `θ - θ_b = (A - A_b)⁻¹ a_bᵀ r_b` (Shao and Wu, *Heteroscedasticity-robustness of jackknife variance estimators in
    linear models*, 1987).

    - `data`: the information of the data, in units in which that of the belief is the identity [p p].
    - `a`: the equations in units of their noise [k n p].
    - `off`: the residuals in the same units [k n].
    """
    k = len(a)
    rows = max(8, int(2 * k ** (1 / 3)))
    blocks = max(2, k // rows)
    whole = data + np.eye(len(data))
    total = np.zeros_like(whole)
    for block in np.array_split(np.arange(k), blocks):
        own = a[block].reshape(-1, a.shape[2])
        change = _inverse(whole - own.T @ own) @ (own.T @ off[block].reshape(-1))
        total += np.outer(change, change)
    return (blocks - 1) / blocks * total
