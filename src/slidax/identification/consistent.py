"""The nearest parameters that bodies and drives can have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .regressor import BODY, PAIRS

STEPS = 60
"""Newton steps for each weight of the barrier at most; some ten are taken."""

LAST = 1e-6
"""The barrier's last weight: so much of the sum of squares, in units of the noise, a bound may cost."""


def pseudo_inertia(phi: np.ndarray) -> np.ndarray:
    """`[Σ h; hᵀ m]` with `Σ = ½ tr(I) 1 - I`, [4 4].

    It is positive semi-definite exactly for what a distribution of mass can have (Wensing, Kim and Slotine, *Linear
    matrix inequalities for physically consistent inertial parameter identification*, RA-L 2018).

    - `phi`: mass, mass times centre, inertia about the frame's origin [10].
    """
    return np.tensordot(phi, BASIS, axes=1)


def consistent(
    theta: np.ndarray, information: np.ndarray, bodies: Sequence[int], positive: np.ndarray, inside: np.ndarray
) -> np.ndarray:
    """The physically consistent θ that fits best: least `½ (θ - θ̂)ᵀ A (θ - θ̂)`.

    Each body's pseudo-inertia is positive definite, and so are the numbers that `positive` names. Where θ̂ itself is so,
    it is the answer. Else by an interior-point method of our own: Newton's steps on the sum with `-μ log det` of each
    pseudo-inertia and `-μ log` of each number, for μ that falls to 1e-6. The barrier is self-concordant, a body has ten
    numbers, and its derivatives are four lines; so no solver of cone programs is needed.

    - `theta`: θ̂, the best without these conditions [p].
    - `information`: A, the inverse of its covariance [p p].
    - `bodies`: where the ten numbers of each body begin.
    - `positive`: which other numbers cannot be negative [p].
    - `inside`: a θ that fulfils the conditions with some room [p].
    """
    if np.isfinite(_barrier(theta, bodies, positive)):
        return theta
    # In units in which the information is about 1 in each number, so that its factors are of good condition.
    unit = 1.0 / np.sqrt(np.diag(information))
    scaled = information * np.outer(unit, unit)
    now, weight = inside.copy(), 1.0
    while weight >= LAST:
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
    """`curve⁻¹ slope` for a positive definite curve; where rounding hides a curvature, with the least that shows."""
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
    """One step, made shorter until it stays inside and descends."""

    def cost(at: np.ndarray) -> float:
        off = at - theta
        return float(0.5 * off @ information @ off) + weight * _barrier(at, bodies, positive)

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
    """Slope and curvature of the barrier: `-tr(J⁻¹ E_i)` and `tr(J⁻¹ E_i J⁻¹ E_j)`, `-1/θ` and `1/θ²`."""
    slope, curve = np.zeros(len(theta)), np.zeros((len(theta), len(theta)))
    slope[positive] = -1.0 / theta[positive]
    curve[positive, positive] = 1.0 / theta[positive] ** 2
    for start in bodies:
        own = slice(start, start + BODY)
        turned = np.linalg.pinv(pseudo_inertia(theta[own]), rcond=1e-300, hermitian=True) @ BASIS
        slope[own] = -np.trace(turned, axis1=1, axis2=2)
        curve[own, own] = np.einsum("aij,bji->ab", turned, turned)
    return slope, curve


def _basis() -> np.ndarray:
    """The contribution of each of the ten parameters to the pseudo-inertia, [10 4 4]."""
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
