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

DRIVE_SCALE = 3.0
"""Prior scale of a drive's parameters, as a multiple of the log's own scale."""

MASS_SHARE = 0.5
"""Prior standard deviation of a link's mass, as a share of the mass."""

STANDSTILL = 1e-3
"""Velocity, rad/s or m/s, below which a joint stands still."""

FEW = 0.2
"""Least share of the rows to use for a moving joint."""

SLOW = 0.03
"""Share of a joint's largest velocity below which dry friction may stick; its equation is not used there."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The equation `τ - known = columns @ θ` at each time and joint, and the prior of θ.

    - `names`, `joints`: name (without the joint) and joint of each parameter; -1 for a parameter without a joint.
    - `columns`: the regressor [k n p].
    - `known`: torque of the known parameters [k n].
    - `prior`, `scale`: prior mean and standard deviation of θ [p].
    - `positive`: True for parameters that cannot be negative [p].
    - `bodies`: index of each body's first parameter.
    - `counts`: True for equations that the fit uses [k n].
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
    stribeck: float | None,
    ripple: Sequence[float],
    ignored: np.ndarray,
) -> Unknowns:
    """The equation of an arm, `τ = Y φ + J q̈ + f_c sign(q̇) + f_v q̇ + f_a |q̇| + f_o`.

    With `stribeck`, there is `f_s exp(-(q̇/v_s)²) sign(q̇)` too, and with `ripple` `c cos(N q) + s sin(N q)` for each N.

    f_o is the offset of the torque measurement, or half the difference of friction between the two directions: a log
    cannot tell them apart. f_a is half the difference of viscous friction between the two directions, if `asymmetric`.

    - `robot`: the arm as it is known.
    - `rotors`, `payload`, `links`: True if rotors, payload, or the links' inertial parameters are unknown.
    - `asymmetric`: True if viscous friction may differ between the two directions.
    - `stribeck`: v_s [rad/s or m/s]; None without Stribeck friction.
    - `ripple`: N, periods of torque ripple per turn.
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
    link_parameters = parameters_of_links(robot)

    def add_body(kind: str, joint: int, believed: np.ndarray, mass: float) -> None:
        bodies.append(len(names))
        for entry, size in zip(BODY_NAMES, (mass, *3 * (mass * REACH,), *6 * (mass * REACH**2,)), strict=True):
            names.append(f"{kind}.{entry}")
            joints.append(joint)
            scale.append(size)
        prior.extend(believed)
        positive.extend(BODY * [False])

    total = max(float(np.sum(robot.masses)), 0.1)
    if links:
        for i in range(n):
            add_body(
                "link", i, link_parameters[i * BODY :][:BODY], MASS_SHARE * max(float(robot.masses[i]), 0.02 * total)
            )
        columns.append(links_regressor(robot, motion))
    if payload:
        add_body("payload", -1, np.zeros(BODY), total)
        columns.append(payload_regressor(robot, motion))
    # Unknown bodies are not part of the known torque.
    carried = parameters_of_payload(robot.payload) * (not payload)
    known = rigid_torque(robot, motion, link_parameters * (not links), carried)

    size = np.sqrt(np.mean(signals.tau**2, axis=0)) + 1e-9
    largest = np.maximum(np.abs(motion.dq).max(axis=0), STANDSTILL)
    drives = [
        ("coulomb", np.sign(motion.dq), np.ones(n), True),
        ("viscous", motion.dq, largest, True),
        ("offset", np.ones_like(motion.dq), np.ones(n), False),
    ]
    if asymmetric:
        drives.append(("asymmetry", np.abs(motion.dq), largest, False))
    if stribeck is not None:
        drives.append(("stribeck", np.sign(motion.dq) * np.exp(-((motion.dq / stribeck) ** 2)), np.ones(n), True))
    for periods in ripple:
        for name, wave in (("cos", np.cos), ("sin", np.sin)):
            drives.append((f"ripple_{periods:g}_{name}", wave(periods * motion.q), np.ones(n), False))
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
        scale.extend(DRIVE_SCALE * size / unit)
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
    """True at rows with sliding friction throughout the filter's settling time; always True for a still joint [k n]."""
    dq = signals.motion.dq
    largest = np.maximum(np.abs(dq).max(axis=0), STANDSTILL)
    dead = np.maximum(SLOW * largest, 4.0 * signals.noise)
    slow = (np.abs(dq) < dead) & (largest > STANDSTILL)
    slides = np.empty(dq.shape, bool)
    for joint in range(dq.shape[1]):
        reach = signals.settled
        while True:
            near = np.convolve(slow[:, joint] * 1.0, np.ones(2 * reach + 1), "same") > 0.5
            slides[:, joint] = ~near & signals.inner
            # A joint that reverses too often for the filter to settle is used closer to its reversals.
            if reach == 0 or slides[:, joint].mean() > FEW:
                break
            reach //= 2
    return slides


PER_CUT_OFF = 3.0
"""Rows kept per period of the cut-off frequency; rows between them add no information."""

ROUNDS = 4
"""Iterations of the weights from the residuals."""


@dataclass(frozen=True, eq=False)
class ParameterFit:
    """The best-fitting parameters and their uncertainty.

    - `theta`: the parameters [p].
    - `covariance`: covariance of their errors [p p].
    - `information`: information of the data and the prior [p p].
    - `gain`: eigenvalues of the data's information relative to the prior's [p], largest first.
    - `lag`, `lag_error`: delay of the torques after the positions, and its standard error [s].
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
    """Weighted least squares on the filtered equation, with the delay of the torques as an additional unknown.

    Each joint's weight is the inverse of its residuals' variance. The covariance is that of `covariance_of_fit` plus
    the prior's.

    - `rows`: the fitted part of the log.
    """
    part = signals.part(rows)
    # Scaled by the prior's standard deviations, the prior's information is the identity.
    columns = part.filtered(unknowns.columns[rows] * unknowns.scale)
    target = part.filtered((signals.tau - unknowns.known)[rows])
    known = part.filtered(unknowns.known[rows])
    counts = unknowns.counts[rows] & part.inner[:, None]
    every = max(1, int(part.rate / (PER_CUT_OFF * part.cut_off)))
    start = np.append(unknowns.prior / unknowns.scale, 0.0)
    solved = start.copy()
    sigma = np.maximum(np.std(target, axis=0), 1e-12)
    # With so few equations a joint may fulfil all: its residuals show no noise then.
    scarce = counts[::every].sum(axis=0) < SCARCE
    floor = np.where(scarce, 0.5 * part.torque_noise(), 0.0) + 1e-6 * np.std(target, axis=0) + 1e-12
    for _ in range(ROUNDS):
        moved = part.slope(known + columns @ solved[:-1])
        x = np.concatenate([columns, -LAG_SCALE * moved[:, :, None]], axis=2)[::every]
        y, used = target[::every], counts[::every]
        weight = used / sigma
        a, b = x * weight[:, :, None], y * weight
        solved = start + _solve_regularised(a.reshape(-1, len(start)), (b - a @ start).ravel())
        off = (y - x @ solved) * used
        size = np.maximum(used.sum(axis=0), 1)
        sigma = np.maximum(np.sqrt((off**2).sum(axis=0) / size), floor)
    data = np.einsum("kip,kiq->pq", a, a)
    identity = np.eye(len(start))
    inverse = _inverse(data + identity)
    rate = part.rate / every
    covariance = covariance_of_fit(a, off / sigma, used, inverse, rate, part.cut_off) + inverse @ inverse
    # Correlated residuals reduce the effective number of samples, and so the data's information against the prior's.
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


SCARCE = 30
"""Equations of a joint below which its noise is taken from the spectrum above the band, too."""

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
"""Smallest share of the degrees of freedom that the fit leaves in a frequency band."""


def covariance_of_fit(
    a: np.ndarray, residuals: np.ndarray, counts: np.ndarray, inverse: np.ndarray, rate: float, cut_off: float
) -> np.ndarray:
    """Return `A⁻¹ (Σ_j a_jᵀ R_j a_j) A⁻¹`, with R_j the covariance matrix of joint j's noise in time, [p p].

    R_j is that of a stationary process, so each sample may be correlated with all others. Its spectral density is
    estimated from the residuals at the frequencies that matter, those where the regressor has its power: model errors,
    such as those of friction, repeat with a periodic motion and have power only there. At each frequency ω the fit
    absorbs some noise, and the residual is smaller than the noise by the leverage `h(ω) = a(ω)* A⁻¹ a(ω)`:

        S(ω) = ⟨h |r|²⟩ / ⟨h (1 - h)⟩ · ⟨h⟩ / ⟨h (1 - h)⟩

    with ⟨ ⟩ the mean over a window, and h as a share of the equations there. The first factor alone is unbiased for few
    unknowns. The second makes the estimate as conservative as a jackknife (HC3 of MacKinnon and White, *Some
    heteroskedasticity-consistent covariance matrix estimators with improved finite sample properties*, 1985).

    The result has full rank. A covariance from sums over blocks of the log has not: with 40 blocks and 80 unknowns,
    some combinations of the unknowns would have no error at all.

    - `a`: the equations in units of their noise, 0 where they are not used [k n p].
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
"""Last barrier weight, the largest increase of the sum of squares, in units of the noise, that a bound may cause."""


def pseudo_inertia(phi: np.ndarray) -> np.ndarray:
    """Pseudo-inertia `[Σ h; hᵀ m]` with `Σ = ½ tr(I) 1 - I`, [4 4].

    It is positive semidefinite if and only if a mass distribution has these parameters (Wensing, Kim and Slotine,
    *Linear matrix inequalities for physically consistent inertial parameter identification*, RA-L 2018).

    - `phi`: mass, mass times centre, inertia about the frame's origin [10].
    """
    return np.tensordot(phi, BASIS, axes=1)


def consistent_parameters(
    theta: np.ndarray, information: np.ndarray, bodies: Sequence[int], positive: np.ndarray, inside: np.ndarray
) -> np.ndarray:
    """The best-fitting physically consistent θ, which minimises `½ (θ - θ̂)ᵀ A (θ - θ̂)`.

    Each body's pseudo-inertia is positive definite, and the parameters marked in `positive` are positive. If θ̂ itself
    fulfils this, it is the result. Otherwise an interior-point method finds θ: Newton steps on the sum with `-μ log
    det` of each pseudo-inertia and `-μ log` of each positive parameter, for μ down to 1e-6. The barrier is
    self-concordant and its derivatives take four lines, so no solver for cone programs is needed.

    - `theta`: θ̂, the unconstrained estimate [p].
    - `information`: A, the inverse of its covariance [p p].
    - `bodies`: index of each body's first parameter.
    - `positive`: True for other parameters that cannot be negative [p].
    - `inside`: a θ strictly inside the constraints [p].
    """
    if np.isfinite(_barrier(theta, bodies, positive)):
        return theta
    # Scaled to information of about 1 in each parameter, so that the factors are well conditioned.
    unit = 1.0 / np.sqrt(np.diag(information))
    scaled = information * np.outer(unit, unit)
    now, weight = inside.copy(), 1.0
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
    """Take a step, shortened until it stays feasible and descends."""

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
    """Gradient and Hessian of the barrier: `-tr(J⁻¹ E_i)` and `tr(J⁻¹ E_i J⁻¹ E_j)`, `-1/θ` and `1/θ²`."""
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
