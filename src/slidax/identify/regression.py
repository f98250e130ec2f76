"""Unknown parameters, weighted least squares with standard errors, and the nearest physically consistent parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from slidax.arms.articulated import Articulated

from .regressor import (
    BODY,
    PAIRS,
    links_regressor,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .signals import LogSignals

REACH = 0.2
"""Prior distance of a body's mass from its frame [m]; it sets the scale of first moment and inertia."""

WIDE = 3.0
"""Prior scale of a drive's parameters, as a multiple of the log's own scale."""

HALF = 0.5
"""Prior standard deviation of a link's mass, as a share of it."""

STANDS = 1e-3
"""A velocity, rad/s or m/s, below which a joint does not move."""

FEW = 0.2
"""A share of the rows that a joint is used in at least, if it moves."""

SLOW = 0.03
"""Of a joint's largest velocity: where it is slower, dry friction may stick, and its equation does not count."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The equation `τ - known = columns @ θ`, at each time and joint, and what is believed of θ before.

    - `names`, `joints`: of each column, `names` without the joint; the joint is -1 where there is none.
    - `columns`: [k n p].
    - `known`: torque that is not in question [k n].
    - `prior`, `scale`: the θ believed before, and how far it may be off [p].
    - `positive`: which cannot be negative [p].
    - `bodies`: where the ten numbers of each body begin.
    - `counts`: which equations count [k n].
    """

    names: tuple[str, ...]
    joints: tuple[int, ...]
    columns: np.ndarray
    known: np.ndarray
    prior: np.ndarray
    scale: np.ndarray
    positive: np.ndarray
    bodies: tuple[int, ...]
    counts: np.ndarray


def unknowns_of(
    robot: Articulated,
    signals: LogSignals,
    *,
    rotors: bool,
    payload: bool,
    links: bool,
    asymmetric: bool,
    ignored: np.ndarray,
) -> Unknowns:
    """The equation of an arm, `τ = Y φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_a |q̇| + f_o`.

    f_o is the offset: of the torque's measurement, or half of what friction differs by between the two directions,
    which look the same. f_a is what viscous friction differs by, taken only if asked for.

    - `robot`: the arm as it is known.
    - `rotors`, `payload`, `links`: whether rotors, payload, and the links' inertial parameters are unknown.
    - `asymmetric`: whether viscous friction may differ between the two directions.
    - `ignored`: True for joints whose torques are not used [n].
    """
    motion, n = signals.motion, robot.joints
    names: list[str] = []
    joints: list[int] = []
    columns: list[np.ndarray] = []
    prior: list[float] = []
    scale: list[float] = []
    positive: list[bool] = []
    bodies: list[int] = []
    of_links = parameters_of_links(robot)

    def add_body(what: str, at: int, believed: np.ndarray, mass: float) -> None:
        bodies.append(len(names))
        for entry, size in zip(BODY_NAMES, (mass, *3 * (mass * REACH,), *6 * (mass * REACH**2,)), strict=True):
            names.append(f"{what}.{entry}")
            joints.append(at)
            scale.append(size)
        prior.extend(believed)
        positive.extend(BODY * [False])

    total = max(float(np.sum(robot.masses)), 0.1)
    if links:
        for i in range(n):
            add_body("link", i, of_links[i * BODY :][:BODY], HALF * max(float(robot.masses[i]), 0.02 * total))
        columns.append(links_regressor(robot, motion))
    if payload:
        add_body("payload", -1, np.zeros(BODY), total)
        columns.append(payload_regressor(robot, motion))
    # Unknown bodies are not part of the known torque.
    carried = parameters_of_payload(robot.payload) * (not payload)
    known = rigid_torque(robot, motion, of_links * (not links), carried)

    size = np.sqrt(np.mean(signals.tau**2, axis=0)) + 1e-9
    largest = np.maximum(np.abs(motion.dq).max(axis=0), STANDS)
    drives = [
        ("coulomb", np.sign(motion.dq), np.ones(n), True),
        ("viscous", motion.dq, largest, True),
        ("offset", np.ones_like(motion.dq), np.ones(n), False),
    ]
    if asymmetric:
        drives.append(("asymmetry", np.abs(motion.dq), largest, False))
    if rotors:
        fastest = np.sqrt(np.mean(motion.ddq**2, axis=0)) + 1e-2
        drives.insert(0, ("armature", motion.ddq, fastest, True))
    else:
        known += motion.ddq * np.asarray(robot.armature)
    for name, basis, unit, nonnegative in drives:
        columns.append(basis[:, :, None] * np.eye(n))
        names.extend(n * [name])
        joints.extend(range(n))
        prior.extend(np.asarray(robot.armature) if name == "armature" else np.zeros(n))
        scale.extend(WIDE * size / unit)
        positive.extend(n * [nonnegative])
    return Unknowns(
        names=tuple(names),
        joints=tuple(joints),
        columns=np.concatenate(columns, axis=2),
        known=known,
        prior=np.array(prior),
        scale=np.array(scale),
        positive=np.array(positive),
        bodies=tuple(bodies),
        counts=mark_moving(signals) & ~ignored,
    )


BODY_NAMES = ("mass", "moment.x", "moment.y", "moment.z", "xx", "yy", "zz", "xy", "xz", "yz")


def mark_moving(signals: LogSignals) -> np.ndarray:
    """True where a joint slides for as long as the filter feels, and for all of a joint that stands [k n]."""
    dq = signals.motion.dq
    largest = np.maximum(np.abs(dq).max(axis=0), STANDS)
    dead = np.maximum(SLOW * largest, 4.0 * signals.noise)
    slow = (np.abs(dq) < dead) & (largest > STANDS)
    slides = np.empty(dq.shape, bool)
    for joint in range(dq.shape[1]):
        reach = signals.settled
        while True:
            near = np.convolve(slow[:, joint] * 1.0, np.ones(2 * reach + 1), "same") > 0.5
            slides[:, joint] = ~near & signals.inner
            # A joint that turns round more often than the filter settles is used closer to its turns.
            if reach == 0 or slides[:, joint].mean() > FEW:
                break
            reach //= 2
    return slides


PER_CUT_OFF = 3.0
"""Rows that are kept per period of the cut-off frequency: between them nothing new is to be seen."""

ROUNDS = 4
"""Times that the weights are found anew from the residuals."""


@dataclass(frozen=True, eq=False)
class ParameterFit:
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


def fit_parameters(unknowns: Unknowns, signals: LogSignals, rows: slice) -> ParameterFit:
    """Weighted least squares on the filtered equation, with a time by which torques lag as one more unknown.

    Each joint's weight is the inverse of its residuals' variance. The covariance is that of
    `covariance_of_fit`, and what the belief adds to it.

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
    rate = part.rate / every
    covariance = covariance_of_fit(a, off / sigma, used, inverse, rate, part.cut_off) + inverse @ inverse
    # By how much fewer samples there seem to be, as residuals are correlated; so that it counts against what was
    # believed, too.
    ratio = max(1.0, float(np.einsum("ij,ji->", data + identity, covariance)) / len(start))
    information = data / ratio + identity
    gain = np.linalg.eigvalsh(data / ratio)[::-1]
    without_lag = information[:-1, :-1] - np.outer(information[:-1, -1], information[-1, :-1]) / information[-1, -1]
    values, vectors = np.linalg.eigh(without_lag)
    alone = (vectors * np.maximum(values, 1.0)) @ vectors.T
    return ParameterFit(
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


WIDTH = 30.0
"""Of the window over frequencies, in multiples of the log's own resolution: so many numbers are averaged."""

FRACTION = 0.25
"""Of the cut-off frequency: the window is no wider, since the residuals' spectrum changes over the filter's band."""

LEAST_ROOM = 0.05
"""A share of the degrees of freedom that the fit leaves at least, in a band of frequencies."""


def covariance_of_fit(
    a: np.ndarray, residuals: np.ndarray, counts: np.ndarray, inverse: np.ndarray, rate: float, cut_off: float
) -> np.ndarray:
    """Return `A⁻¹ (Σ_j a_jᵀ R_j a_j) A⁻¹`, with R_j the covariance matrix of joint j's noise in time, [p p].

    R_j is that of a stationary process, so that each sample may be correlated with all others. Its spectral density is
    estimated from the residuals where it matters, at the frequencies at which the regressor has its power: errors of
    the model, such as those of friction, repeat with a periodic motion and have their power there alone. At each
    frequency ω the fit takes up noise, and the residual is smaller than it by the leverage `h(ω) = a(ω)* A⁻¹ a(ω)`:

        S(ω) = ⟨h |r|²⟩ / ⟨h (1 - h)⟩ · ⟨h⟩ / ⟨h (1 - h)⟩

    with ⟨ ⟩ the mean over a window, and h as a share of the equations there. The first factor alone is unbiased for few
    unknowns. The second makes it as careful as a jackknife (HC3 of MacKinnon and White, *Some heteroskedasticity-
    consistent covariance matrix estimators with improved finite sample properties*, 1985).

    The result is of full rank. One from sums over blocks of the log is not: with 40 blocks and 80 unknowns it gives
    combinations of the unknowns no error at all.

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
        # Of both signs of the frequency; twice, for a window without steps.
        both = np.concatenate([values, values[1 : points - len(values) + 1][::-1]])
        once = ndimage.uniform_filter1d(both, width, mode="wrap")
        return ndimage.uniform_filter1d(once, width, mode="wrap")[: len(values)]

    # Of real signals: a negative frequency has the same share as the positive one.
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
        room = np.maximum(1.0 - leverage / used, LEAST_ROOM)
        # Rounding must not decide where the filter has left nothing.
        leverage += 1e-6 * leverage.mean()
        left = averaged(leverage * room)
        density = averaged(leverage * power) * averaged(leverage) / (used * left**2)
        # A moving sum may round below 0; and with the weighted columns no rounding makes a variance negative.
        total += ((weighted.conj() * (np.maximum(density, 0.0) * share)[:, None]).T @ weighted).real
    return total


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


def consistent_parameters(
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
