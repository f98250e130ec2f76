"""Example 4.1 as one would script it in plain NumPy: arrays of length 2, one pass through a Python loop per sample.

The two-link arm of "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for
uncertain robotic manipulators" (Nonlinear Dynamics, 2022, doi 10.1007/s11071-022-07650-w) under the CFTSMPPC law (51),
the torque held over a sampling period and the plant stepped by semi-implicit Euler. It is the baseline for speed and
stands alone on purpose. Numbers in parentheses are the paper's equations.
"""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Table 1, row CFTSMPPC; LOWER and UPPER are (13) for e(0) = [-0.6, 0.5].
RHO_0, RHO_INF, T_RHO = np.array([0.8, 0.6]), np.array([0.002, 0.002]), np.array([5.0, 6.0])
LOWER, UPPER = np.array([-1.0, -0.2]), np.array([0.2, 1.0])
SIGMA, P, Q, R, DELTA, S0 = 2.01, 0.5, 1.2, 1.2, 0.01, 0.05
K0, K1, K2 = 0.1 * np.eye(2), 0.2 * np.eye(2), 0.6 * np.eye(2)
K, B0, B1, B2 = 1.0, 12.0, 2.2, 2.8
GAMMA = (0.2 - 0.09) / (0.2 + 0.09)  # (46)
SP1 = (P**2 / 2 - 5 * P / 2 + 3) * DELTA ** (P - 1)  # (30)
SP2 = (-(P**2) + 4 * P - 3) * DELTA ** (P - 2)  # (31)
SP3 = (P**2 / 2 - 3 * P / 2 + 1) * DELTA ** (P - 3)  # (32)
TRUE_ARM, NOMINAL_ARM = (0.5, 1.5, 5.0), (0.6, 1.8, 6.0)  # both masses, the moment of inertia of either link
BANDS = ("1e-2", "1e-3", "1e-4", "1e-5", "1e-8")


def reference(t: float) -> tuple[Array, Array, Array]:
    """Desired position, velocity and acceleration."""
    e1, e4 = np.exp(-t), np.exp(-4 * t)
    q = np.array([1.25 - 7 / 5 * e1 + 7 / 20 * e4, 1.25 + e1 - 1 / 4 * e4])
    dq = np.array([7 / 5 * e1 - 7 / 5 * e4, -e1 + e4])
    ddq = np.array([-7 / 5 * e1 + 28 / 5 * e4, e1 - 4 * e4])
    return q, dq, ddq


def disturbance(t: float) -> Array:
    """External torque."""
    ripple = 0.5 * np.sin(200 * np.pi * t)
    return np.array([2 * np.sin(t) + ripple, np.cos(2 * t) + ripple])


def arm(q: Array, dq: Array, parameters: tuple[float, float, float]) -> tuple[Array, Array, Array]:
    """Inertia, Coriolis matrix and gravity of the two-link arm."""
    (m1, m2, inertia), l1, l2, g = parameters, 1.0, 0.8, 9.8
    m12 = m2 * l2**2 + m2 * l1 * l2 * np.cos(q[1])
    m22 = m2 * l2**2 + inertia
    m11 = (m1 + m2) * l1**2 + m2 * l2**2 + 2 * m2 * l1 * l2 * np.cos(q[1]) + inertia
    h = m2 * l1 * l2 * np.sin(q[1])
    g2 = m2 * l2 * g * np.cos(q[0] + q[1])
    mass = np.array([[m11, m12], [m12, m22]])
    coriolis = np.array([[-h * dq[1], -h * (dq[0] + dq[1])], [h * dq[0], 0.0]])
    return mass, coriolis, np.array([(m1 + m2) * l1 * g * np.cos(q[0]) + g2, g2])


def performance(t: float) -> tuple[Array, Array, Array]:
    """Performance function (20) with its first (B5) and second derivative."""
    left = np.maximum(1 - t / T_RHO, 0.0)  # 0 from T on, where all three powers vanish
    span = RHO_0 - RHO_INF
    rho = span * left**SIGMA + RHO_INF
    drho = -SIGMA / T_RHO * span * left ** (SIGMA - 1)
    ddrho = SIGMA * (SIGMA - 1) / T_RHO**2 * span * left ** (SIGMA - 2)
    return rho, drho, ddrho


def sig(x: Array, power: float) -> Array:
    """Signed power (2)."""
    return np.abs(x) ** power * np.sign(x)


def control(q: Array, dq: Array, target: tuple[Array, Array, Array], bounds: tuple[Array, Array, Array]) -> Array:
    """Torque of the law (41)-(43), (51)."""
    (qd, dqd, ddqd), (rho, drho, ddrho) = target, bounds
    e, de = q - qd, dq - dqd
    x = e / rho
    eps1 = np.log(UPPER * (x - LOWER) / (-LOWER * (UPPER - x)))  # (24)
    alpha = -drho / rho  # (26)
    dalpha = -(ddrho * rho - drho**2) / rho**2
    beta = (1 / (x - LOWER) + 1 / (UPPER - x)) / rho  # (27)
    eps2 = beta * (de + alpha * e)  # (28)

    a = np.abs(eps1)
    far = np.maximum(a, DELTA)  # keeps the unused branch of np.where finite at zero
    sp = np.where(a >= DELTA, sig(eps1, P), SP1 * eps1 + SP2 * sig(eps1, 2) + SP3 * eps1**3)  # (29)
    fp = np.where(a >= DELTA, P * far ** (P - 1), SP1 + 2 * SP2 * a + 3 * SP3 * eps1**2)  # (33)
    sq, hq = sig(eps1, Q), Q * a ** (Q - 1)  # (34), (35)
    s = de + alpha * e + K1 @ sp + K2 @ sq  # (40)

    m0, c0, g0 = arm(q, dq, NOMINAL_ARM)
    tau0 = m0 @ (ddqd - dalpha * e - alpha * de) + c0 @ dq + g0  # (42)
    tau1 = -K0 @ sig(s, R) - m0 @ (K1 @ np.diag(fp) + K2 @ np.diag(hq)) @ eps2  # (43)
    u = K + B0 + B1 * np.linalg.norm(q) + B2 * np.linalg.norm(dq) ** 2 + GAMMA * np.linalg.norm(tau0 + tau1)
    tau: Array = tau0 + tau1 - u / (1 - GAMMA) * s / (np.linalg.norm(s) + S0)  # (45), (51)
    return tau


def run(steps: int = 100_000, period: float = 1e-4, disturbance_scale: float = 1.0) -> dict[str, Any]:
    """Run samples 0 to ``steps``, and return the metrics, one number per joint, and the time per sample.

    As in ``example_4_1 held``, the run ends at the first sample on or outside the envelope, where the law is
    undefined; a metric without samples is then 0.
    """
    t = np.arange(steps + 1) * period
    errors, widths, torques = np.empty((steps + 1, 2)), np.empty((steps + 1, 2)), np.empty((steps + 1, 2))
    q, dq = np.array([-0.4, 2.5]), np.zeros(2)
    leaving, done = False, 0
    start = time.perf_counter()
    for k in range(steps + 1):
        target, bounds = reference(t[k]), performance(t[k])
        errors[k], widths[k] = q - target[0], bounds[0]
        leaving = not np.all((errors[k] > LOWER * bounds[0]) & (errors[k] < UPPER * bounds[0]))
        if leaving:
            break
        torques[k] = tau = control(q, dq, target, bounds)
        done = k + 1
        if k < steps:
            mass, coriolis, gravity = arm(q, dq, TRUE_ARM)
            force = tau + disturbance_scale * disturbance(t[k]) - coriolis @ dq - gravity
            dq = dq + period * np.linalg.solve(mass, force)
            q = q + period * dq  # with the new velocity: semi-implicit
    elapsed = time.perf_counter() - start

    sampled = done + leaving  # the sample that leaves has an error but no torque
    t, late_from = t[:sampled], 0.75 * steps * period
    errors, widths, torques = errors[:sampled], widths[:sampled], torques[:done]
    a, changes, late = np.abs(errors), np.abs(np.diff(torques, axis=0)), t >= late_from
    ratio = errors / widths
    settling = {}
    for band in BANDS:
        above = [np.flatnonzero(a[:, i] > float(band)) for i in range(2)]
        settling[band] = [float(t[w[-1]]) if w.size else None for w in above]
    return {
        "mode": "held",
        "steps": steps,
        "period": period,
        "disturbance_scale": disturbance_scale,
        "outcome": "left_envelope" if leaving else "completed",
        "settling": settling,
        "steady_error": a[late].max(axis=0, initial=0.0).tolist(),
        "peak_torque": np.abs(torques).max(axis=0, initial=0.0).tolist(),
        "initial_torque": np.abs(torques[:1]).max(axis=0, initial=0.0).tolist(),
        "max_torque_step": changes.max(axis=0, initial=0.0).tolist(),
        "late_max_torque_step": changes[late[: len(changes)]].max(axis=0, initial=0.0).tolist(),
        "iae": a[t > 2].sum(axis=0).tolist(),  # (80)
        "eci": (torques**2).sum(axis=0).tolist(),  # (81)
        "aice": changes.sum(axis=0).tolist(),  # (82)
        "min_margin": (np.minimum(ratio - LOWER, UPPER - ratio).min(axis=0) / (UPPER - LOWER)).tolist(),
        "samples_outside": int(leaving),
        "samples": done,
        "ns_per_step": 1e9 * elapsed / max(done, 1),
    }
