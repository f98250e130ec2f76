"""Weighted least squares with standard errors, and the nearest physically consistent parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, ndimage

from slidax.arms.articulated import PAIRS

from .regressor import BODY
from .signals import LogSignals
from .unknowns import Unknowns

PER_CUT_OFF = 3.0
"""Number of rows to keep per period of the cut-off frequency; rows in between add no information."""

ROUNDS = 4
"""Number of fits, each with weights from the residuals of the previous one."""


@dataclass(frozen=True, eq=False)
class ParameterFit:
    """The best-fitting parameters of one or more logs, and their uncertainty.

    - `theta`: the parameters [p].
    - `covariance`: covariance of their errors [p p].
    - `information`: information matrix of data and prior [p p].
    - `gain`: eigenvalues of the data's information matrix, for parameters and delays in units of their prior standard
      deviations [p + logs], largest first.
    - `lag`, `lag_error`: delay of each log's torques after its positions, and its standard error [logs], s.
    - `sigma`: standard deviation of each joint's torque residuals [logs n], N m or N.
    """

    theta: np.ndarray
    covariance: np.ndarray
    information: np.ndarray
    gain: np.ndarray
    lag: np.ndarray
    lag_error: np.ndarray
    sigma: np.ndarray


class _Equations:
    """A log's filtered equations, scaled by the prior's standard deviations, so that the prior has unit information."""

    def __init__(self, unknowns: Unknowns, part: LogSignals) -> None:
        self.part, rows = part, slice(0, len(part.t))
        self.columns = part.filtered(unknowns.columns[rows] * unknowns.scale)
        self.target = part.filtered(part.tau - unknowns.known[rows])
        self.known = part.filtered(unknowns.known[rows])
        self.every = max(1, int(part.rate / (PER_CUT_OFF * part.cut_off)))
        self.counts = (unknowns.counts[rows] & part.inner[:, None])[:: self.every]
        # The fit may fulfil so few equations of a joint exactly, and their residuals then show no noise.
        scarce = self.counts.sum(axis=0) < SCARCE
        size = np.std(self.target, axis=0)
        self.floor = np.where(scarce, 0.5 * part.torque_noise(), 0.0) + 1e-6 * size + 1e-12
        self.sigma = np.maximum(size, 1e-12)

    def with_lag(self, theta: np.ndarray, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return regressor and target, with the delays of all logs as additional unknowns.

        - `theta`: the scaled parameters, about which the delay is linearised.
        - `lags`: 1 for this log's delay, 0 for those of other logs [logs].
        """
        moved = self.part.slope(self.known + self.columns @ theta)[:: self.every]
        x = np.concatenate([self.columns[:: self.every], -LAG_SCALE * moved[:, :, None] * lags], axis=2)
        return x, self.target[:: self.every]


def fit_parameters(unknowns: Sequence[Unknowns], signals: Sequence[LogSignals]) -> ParameterFit:
    """Weighted least squares on the filtered equations of one or more logs; each log's torque delay is an unknown, too.

    Each joint's weight is the inverse of its residuals' variance in the log. The covariance is the sum of the logs'
    covariances from `covariance_of_fit`, since their noise is independent, plus the prior's.

    - `unknowns`: the equation of each log, with the same parameters.
    - `signals`: the fitted part of each log.
    """
    logs = [_Equations(*each) for each in zip(unknowns, signals, strict=True)]
    scale, p, lags = unknowns[0].scale, len(unknowns[0].scale), np.eye(len(logs))
    start = np.append(unknowns[0].prior / scale, np.zeros(len(logs)))
    solved = start.copy()
    for _ in range(ROUNDS):
        blocks = []
        for log, lag in zip(logs, lags, strict=True):
            x, y = log.with_lag(solved[:p], lag)
            weight = log.counts / log.sigma
            blocks.append((x, y, x * weight[:, :, None], y * weight))
        a = np.concatenate([block.reshape(-1, len(start)) for _, _, block, _ in blocks])
        b = np.concatenate([(right - block @ start).ravel() for _, _, block, right in blocks])
        solved = start + _solve_regularised(a, b)
        residuals = []
        for log, (x, y, *_) in zip(logs, blocks, strict=True):
            off = (y - x @ solved) * log.counts
            size = np.maximum(log.counts.sum(axis=0), 1)
            log.sigma = np.maximum(np.sqrt((off**2).sum(axis=0) / size), log.floor)
            residuals.append(off / log.sigma)
    data = sum(np.einsum("kip,kiq->pq", block, block) for _, _, block, _ in blocks)
    identity = np.eye(len(start))
    inverse = _inverse(data + identity)
    covariance = inverse @ inverse
    for log, (_, _, block, _), off in zip(logs, blocks, residuals, strict=True):
        rate = log.part.rate / log.every
        covariance = covariance_of_fit(block, off, log.counts, inverse, rate, log.part.cut_off) + covariance
    # Correlated residuals reduce the effective number of samples, and so the data's information relative to the prior.
    ratio = max(1.0, float(np.einsum("ij,ji->", data + identity, covariance)) / len(start))
    information = data / ratio + identity
    gain = np.linalg.eigvalsh(data / ratio)[::-1]
    without_lags = information[:p, :p]
    # No equation contains the delays of two logs, so each delay can be eliminated by itself.
    for i in range(p, len(start)):
        without_lags = without_lags - np.outer(information[:p, i], information[i, :p]) / information[i, i]
    values, vectors = np.linalg.eigh(without_lags)
    alone = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return ParameterFit(
        theta=solved[:p] * scale,
        covariance=covariance[:p, :p] * np.outer(scale, scale),
        information=alone / np.outer(scale, scale),
        gain=np.maximum(gain, 0.0),
        lag=solved[p:] * LAG_SCALE,
        lag_error=np.sqrt(np.diag(covariance)[p:]) * LAG_SCALE,
        sigma=np.array([log.sigma for log in logs]),
    )


DISAGREE = 1.5
"""Residual of a log in a combined fit, as a multiple of the residual in its own fit, above which the logs disagree."""


def with_disagreement(
    fitted: ParameterFit, unknowns: Sequence[Unknowns], signals: Sequence[LogSignals]
) -> tuple[ParameterFit, np.ndarray]:
    """Return the combined fit with a larger covariance if logs disagree, and ratios of residuals [logs n].

    A ratio is a log's residual in the combined fit over that in a fit of this log alone. A log that the others
    contradict, for instance since the arm's load or friction differed, has large residuals and so a small weight. The
    covariance C therefore gains `d dᵀ`. Here d is the step from the combined θ to the log's own fit, for which the
    combined θ is the prior mean. Then `dᵀ (C + d dᵀ)⁻¹ d < 1`, and the own fit lies in every usual confidence region.

    - `fitted`: the combined fit.
    - `unknowns`, `signals`: as for `fit_parameters`.
    """
    covariance, ratios = fitted.covariance, np.ones_like(fitted.sigma)
    if len(unknowns) == 1:
        return fitted, ratios
    for k, (equation, signal) in enumerate(zip(unknowns, signals, strict=True)):
        own = fit_parameters([replace(equation, prior=fitted.theta)], [signal])
        ratios[k] = fitted.sigma[k] / own.sigma[0]
        if np.max(ratios[k]) > DISAGREE:
            step = own.theta - fitted.theta
            covariance = covariance + np.outer(step, step)
    return replace(fitted, covariance=covariance), ratios


SCARCE = 30
"""Number of a joint's equations below which its noise has a lower bound from the torque's spectrum above the band."""

LAG_SCALE = 0.01
"""Prior standard deviation of the torques' lag [s]."""


def _solve_regularised(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Minimise `|a x - b|² + |x|²` by orthogonal factors, which are regular for every log."""
    factor = np.linalg.qr(np.column_stack([a, b]), mode="r")
    u, s, vt = np.linalg.svd(factor[:, :-1], full_matrices=False)
    return vt.T @ (s / (s**2 + 1.0) * (u.T @ factor[:, -1]))


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix whose eigenvalues are at least 1 up to rounding."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors / np.maximum(values, 1.0)) @ vectors.T


WIDTH = 30.0
"""Width of the averaging window over frequencies, in multiples of the log's frequency resolution."""

FRACTION = 0.25
"""Largest window as a share of the cut-off frequency, since the residuals' spectrum changes over the filter's band."""

LEAST_FREEDOM = 0.05
"""Lower bound of 1 - h in `covariance_of_fit`, the share of the noise that the fit leaves at a frequency."""


def covariance_of_fit(
    a: np.ndarray, residuals: np.ndarray, counts: np.ndarray, inverse: np.ndarray, rate: float, cut_off: float
) -> np.ndarray:
    """Return the covariance `A⁻¹ (Σ_j a_jᵀ R_j a_j) A⁻¹` of the error that noise causes in a least-squares fit, [p p].

    A is the information matrix of data and prior, a_j the regressor of joint j [k p], and R_j the covariance matrix of
    this joint's noise in time [k k]. The noise is a stationary process, so each sample may be correlated with all
    others. Its spectral density S is estimated from the residuals, weighted by the regressor's power at each frequency.
    Model errors, such as those of friction, repeat with a periodic motion, and have power at the same frequencies as
    the regressor. At each frequency ω the fit absorbs a share of the noise, the leverage `h(ω) = a(ω)* A⁻¹ a(ω)`:

        S(ω) = ⟨h |r|²⟩ / ⟨h (1 - h)⟩ · ⟨h⟩ / ⟨h (1 - h)⟩

    with a(ω) and r the Fourier transforms of regressor and residual, h and |r|² relative to the number of equations,
    and ⟨ ⟩ the mean over a window of frequencies. The first factor alone is unbiased for few unknowns. The second makes
    the estimate as conservative as a jackknife (HC3 of MacKinnon and White, *Some heteroskedasticity-consistent
    covariance matrix estimators with improved finite sample properties*, 1985).

    The result has full rank. A covariance from sums over blocks of the log has not: with 40 blocks and 80 unknowns,
    some combinations of the unknowns would have no error at all.

    - `a`: the regressor in units of the noise, 0 where an equation is not used [k n p].
    - `residuals`: residuals in the same units, 0 where they are not used [k n].
    - `counts`: True for equations that are used [k n].
    - `inverse`: A⁻¹ [p p].
    - `rate`: rows per second [Hz].
    - `cut_off`: cut-off frequency of the equations' filter [Hz].
    """
    k = len(a)
    points = fft.next_fast_len(2 * k)
    resolution = rate / k
    window = min(WIDTH * resolution, max(FRACTION * cut_off, resolution))
    width = max(1, round(window * points / rate))

    def averaged(values: np.ndarray) -> np.ndarray:
        # Over both signs of the frequency; applied twice, which gives a continuous window.
        both = np.concatenate([values, values[1 : points - len(values) + 1][::-1]])
        once = ndimage.uniform_filter1d(both, width, mode="wrap")
        return ndimage.uniform_filter1d(once, width, mode="wrap")[: len(values)]

    # For real signals the negative frequencies contribute the same as the positive ones.
    share = np.where((np.arange(points // 2 + 1) * 2) % points == 0, 1.0, 2.0) / points
    total = np.zeros_like(inverse)
    for joint in range(a.shape[1]):
        used = float(counts[:, joint].sum())
        columns = fft.rfft(a[:, joint], points, axis=0)
        weighted = columns @ inverse
        leverage = np.einsum("wp,wp->w", weighted.conj(), columns).real
        if not used or not leverage.any():
            continue
        power = np.abs(fft.rfft(residuals[:, joint], points)) ** 2
        freedom = np.maximum(1.0 - leverage / used, LEAST_FREEDOM)
        # Where the filter leaves no power, rounding errors must not determine the result.
        leverage += 1e-6 * leverage.mean()
        left = averaged(leverage * freedom)
        density = averaged(leverage * power) * averaged(leverage) / (used * left**2)
        # A moving sum may round below 0. This product of weighted columns cannot give a negative variance.
        total += ((weighted.conj() * (np.maximum(density, 0.0) * share)[:, None]).T @ weighted).real
    return total


STEPS = 60
"""Newton steps per barrier weight at most; about ten are usual."""

LAST_WEIGHT = 1e-6
"""Last barrier weight μ in `consistent_parameters`: the minimised function exceeds its minimum by about μ per bound."""


def pseudo_inertia(phi: np.ndarray) -> np.ndarray:
    """Return a body's pseudo-inertia `[Σ h; hᵀ m]` with `Σ = ½ tr(I) 1 - I`, [4 4].

    It is positive semidefinite if and only if a mass distribution has these parameters (Wensing, Kim and Slotine,
    *Linear matrix inequalities for physically consistent inertial parameter identification*, RA-L 2018).

    - `phi`: mass m, mass times centre h, and inertia I about the frame's origin as xx, yy, zz, xy, xz, yz [10].
    """
    return np.tensordot(phi, BASIS, axes=1)


def consistent_parameters(
    theta: np.ndarray,
    information: np.ndarray,
    bodies: Sequence[int],
    positive: np.ndarray,
    inside: np.ndarray,
    *,
    far: bool = False,
) -> np.ndarray:
    """Return the best-fitting physically consistent θ, which minimises `½ (θ - θ̂)ᵀ A (θ - θ̂)`.

    Each body's pseudo-inertia is positive definite, and the parameters marked in `positive` are positive. If θ̂ itself
    fulfils both conditions, it is the result. Otherwise an interior-point method determines θ. It takes Newton steps on
    the sum of this function, `-μ log det` of each pseudo-inertia and `-μ log` of each positive parameter, for μ down to
    1e-6. The barrier is self-concordant, so the steps converge without a solver for cone programs.

    - `theta`: θ̂, the unconstrained estimate [p].
    - `information`: A, the estimate's information matrix [p p].
    - `bodies`: index of each body's first parameter.
    - `positive`: True for other parameters that cannot be negative [p].
    - `inside`: a θ strictly inside the constraints [p].
    - `far`: True to start from a larger barrier, for a θ̂ far from `inside`.
    """
    if np.isfinite(_barrier(theta, bodies, positive)):
        return theta
    # Scaled to information of about 1 in each parameter, so that the factors are well conditioned.
    unit = 1.0 / np.sqrt(np.diag(information))
    scaled = information * np.outer(unit, unit)
    now = inside.copy()
    # Far from the solution, Newton steps converge in time only from a barrier as large as the sum of squares.
    weight = max(1.0, float((inside - theta) @ information @ (inside - theta))) if far else 1.0
    while weight >= LAST_WEIGHT:
        for _ in range(STEPS):
            slope, curve = _derivatives(now, bodies, positive)
            slope = weight * slope * unit + scaled @ ((now - theta) / unit)
            curve = weight * curve * np.outer(unit, unit) + scaled
            step = -_solve_positive(curve, slope)
            decrement = float(-slope @ step)
            if decrement < 1e-9 * max(weight, 1e-3):
                break
            now = _descend(now, step * unit, decrement, theta, information, weight, bodies, positive)
        weight *= 0.1
    return now


def _solve_positive(curve: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return `curve⁻¹ slope` for a positive definite curve; eigenvalues below the rounding error are raised to it."""
    values, vectors = np.linalg.eigh(curve)
    return vectors @ ((vectors.T @ slope) / np.maximum(values, 1e-15 * values[-1]))


def _descend(
    now: np.ndarray,
    step: np.ndarray,
    decrement: float,
    theta: np.ndarray,
    information: np.ndarray,
    weight: float,
    bodies: Sequence[int],
    positive: np.ndarray,
) -> np.ndarray:
    """Return the point after a step, which is halved until it is feasible and decreases the cost."""

    def cost(point: np.ndarray) -> float:
        off = point - theta
        return float(0.5 * off @ information @ off) + weight * _barrier(point, bodies, positive)

    here, share = cost(now), 1.0
    while share > 1e-12:
        there = now + share * step
        value = cost(there)
        if value <= here - 1e-4 * share * decrement + 1e-12 * abs(here):
            return there
        share *= 0.5
    return now


def _barrier(theta: np.ndarray, bodies: Sequence[int], positive: np.ndarray) -> float:
    numbers = theta[positive]
    if (numbers <= 0).any():
        return np.inf
    total = -float(np.sum(np.log(numbers)))
    for start in bodies:
        matrix = pseudo_inertia(theta[start : start + BODY])
        try:
            total -= 2.0 * float(np.sum(np.log(np.diag(np.linalg.cholesky(matrix)))))
        except np.linalg.LinAlgError:
            return np.inf
    return total


def _derivatives(theta: np.ndarray, bodies: Sequence[int], positive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return gradient and Hessian of the barrier.

    They are `-tr(J⁻¹ E_i)` and `tr(J⁻¹ E_i J⁻¹ E_j)` for a body's pseudo-inertia J with `E_i = ∂J/∂φ_i`, and `-1/θ` and
    `1/θ²` for a positive parameter.
    """
    slope, curve = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    slope[positive] = -1.0 / theta[positive]
    curve[positive, positive] = 1.0 / theta[positive] ** 2
    for start in bodies:
        own = slice(start, start + BODY)
        product = np.linalg.pinv(pseudo_inertia(theta[own]), rcond=1e-300, hermitian=True) @ BASIS
        slope[own] = -np.trace(product, axis1=1, axis2=2)
        curve[own, own] = np.einsum("aij,bji->ab", product, product)
    return slope, curve


def _basis() -> np.ndarray:
    """Return the matrix that each of a body's ten parameters multiplies in the pseudo-inertia, [10 4 4]."""
    basis = np.zeros((BODY, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
    for entry, (i, j) in enumerate(PAIRS):
        if i == j:
            basis[4 + entry, :3, :3] = 0.5 * np.eye(3)
            basis[4 + entry, i, i] -= 1.0
        else:
            basis[4 + entry, i, j] = basis[4 + entry, j, i] = -1.0
    return basis


BASIS = _basis()
