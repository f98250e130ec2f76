"""Laws in plain NumPy, written from their equations without code of the package."""

from typing import NamedTuple

import numpy as np


class Gains(NamedTuple):
    """Tables 1 and 2, by the paper's symbols."""

    rho0: np.ndarray
    rho_inf: np.ndarray
    T: np.ndarray
    sigma: float = 2.01
    theta: float = 0.2
    delta: float = 0.01
    p: float = 0.5
    q: float = 1.2
    r: float = 1.2
    m1: float = 0.09
    m2: float = 0.2
    k: float = 1.0
    s0: float = 0.05
    b0: float = 12.0
    b1: float = 2.2
    b2: float = 2.8
    K0: float = 0.1
    K1: float = 0.2
    K2: float = 0.6


TABLE_1 = Gains(np.array([0.8, 0.6]), np.array([0.002, 0.002]), np.array([5.0, 6.0]))
TABLE_2 = Gains(np.full(3, 1.2), np.full(3, 0.002), np.array([5.0, 6.0, 7.0]), m1=0.9, m2=1.1)


def torque(g: Gains, t, e0, q, dq, qd, dqd, ddqd, matrices):
    """τ of (41); `matrices(q, dq)` gives M0, C0, G0. Returns τ, s, ε1, ε2 and u."""
    e, de = q - qd, dq - dqd
    n = len(q)
    rho, drho, ddrho = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        if t < g.T[i]:
            width, z = g.rho0[i] - g.rho_inf[i], 1 - t / g.T[i]
            rho[i] = width * z**g.sigma + g.rho_inf[i]
            drho[i] = -(g.sigma / g.T[i]) * width * z ** (g.sigma - 1)
            ddrho[i] = g.sigma * (g.sigma - 1) / g.T[i] ** 2 * width * z ** (g.sigma - 2)
        else:
            rho[i], drho[i], ddrho[i] = g.rho_inf[i], 0.0, 0.0
    b = np.where(e0 >= 0, -g.theta, -1.0)
    b_bar = np.where(e0 >= 0, 1.0, g.theta)

    x = e / rho
    eps1 = np.log(b_bar * (x - b) / (-b * (b_bar - x)))
    A = np.diag(-drho / rho)
    dA = np.diag(-(ddrho * rho - drho**2) / rho**2)
    B = np.diag((1 / (x - b) + 1 / (b_bar - x)) / rho)
    eps2 = B @ (de + A @ e)

    l1 = (g.p**2 / 2 - 5 * g.p / 2 + 3) * g.delta ** (g.p - 1)
    l2 = (-(g.p**2) + 4 * g.p - 3) * g.delta ** (g.p - 2)
    l3 = (g.p**2 / 2 - 3 * g.p / 2 + 1) * g.delta ** (g.p - 3)
    S_p, F_p = np.empty(n), np.empty(n)
    for i, y in enumerate(eps1):
        if abs(y) >= g.delta:
            S_p[i], F_p[i] = abs(y) ** g.p * np.sign(y), g.p * abs(y) ** (g.p - 1)
        else:
            S_p[i] = l1 * y + l2 * abs(y) ** 2 * np.sign(y) + l3 * y**3
            F_p[i] = l1 + 2 * l2 * abs(y) + 3 * l3 * y**2
    S_q, H_q = np.abs(eps1) ** g.q * np.sign(eps1), g.q * np.abs(eps1) ** (g.q - 1)

    s = np.linalg.inv(B) @ eps2 + g.K1 * S_p + g.K2 * S_q
    M0, C0, G0 = matrices(q, dq)
    tau0 = M0 @ (ddqd - dA @ e - A @ de) + C0 @ dq + G0
    tau1 = -g.K0 * np.abs(s) ** g.r * np.sign(s) - M0 @ (np.diag(g.K1 * F_p + g.K2 * H_q) @ eps2)
    gamma = (g.m2 - g.m1) / (g.m2 + g.m1)
    size = np.linalg.norm(tau0 + tau1)
    u = (g.k + g.b0 + g.b1 * np.linalg.norm(q) + g.b2 * np.linalg.norm(dq) ** 2 + gamma * size) / (1 - gamma)
    length = np.linalg.norm(s) + g.s0
    tau2 = -u * s / length if length > 0 else np.zeros(n)
    return tau0 + tau1 + tau2, s, eps1, eps2, u


def sig(x, a):
    return np.abs(x) ** a * np.sign(x)


def unit(s, layer=0.0):
    length = np.linalg.norm(s) + layer
    return s / length if length > 0 else np.zeros_like(s)


def robust(m1, m2, k, b0, b2, dq, tau):
    gamma = (m2 - m1) / (m2 + m1)
    return (k + b0 + b2 * np.linalg.norm(dq) ** 2 + gamma * np.linalg.norm(tau)) / (1 - gamma)


def hat_power(x, p, delta):
    """ŝ^p of (78), and its slope."""
    value = [abs(v) ** p * np.sign(v) if abs(v) >= delta else delta ** (p - 1) * v for v in x]
    slope = [p * abs(v) ** (p - 1) if abs(v) >= delta else delta ** (p - 1) for v in x]
    return np.array(value), np.array(slope)


def blend(x, a, r, delta):
    """S_α of [24], and its slope."""
    l1 = (r - a) / (r - 1) * delta ** (a - 1)
    l2 = (a - 1) / (r - 1) * delta ** (a - r)
    value = [abs(v) ** a * np.sign(v) if abs(v) >= delta else l1 * v + l2 * abs(v) ** r * np.sign(v) for v in x]
    slope = [a * abs(v) ** (a - 1) if abs(v) >= delta else l1 + r * l2 * abs(v) ** (r - 1) for v in x]
    return np.array(value), np.array(slope)


def ftsmc(q, dq, qd, dqd, ddqd, matrices, layer):
    """[23] with Table 1."""
    p, r, delta, exponent = 0.5, 1.2, 0.01, 1.2
    K0, K1, K2 = np.eye(2), 1.5 * np.eye(2), np.eye(2)
    M0, C0, G0 = matrices(q, dq)
    e, de = q - qd, dq - dqd
    near, near_slope = hat_power(e, p, delta)
    s = de + K1 @ near + K2 @ sig(e, exponent)
    tau0 = M0 @ ddqd + C0 @ dq + G0
    H = exponent * np.abs(e) ** (exponent - 1)
    tau1 = -K0 @ sig(s, r) - M0 @ (K1 @ np.diag(near_slope) + K2 @ np.diag(H)) @ de
    u = robust(0.09, 0.2, 1.0, 12.0, 2.8, dq, tau0 + tau1)
    return tau0 + tau1 - u * unit(s, layer), s, u


def sfsmc(q, dq, qd, dqd, ddqd, matrices, layer):
    """[24] with Table 2."""
    C1 = C2 = 2.0
    M0, C0, G0 = matrices(q, dq)
    e, de = q - qd, dq - dqd
    near, near_slope = blend(e, 0.7, 1.7, 0.3)
    s = de + C1 * near + C2 * sig(e, 1.9)
    tau0 = M0 @ (ddqd - (C1 * near_slope + C2 * 1.9 * np.abs(e) ** 0.9) * de) + C0 @ dq + G0
    tau1 = -5.0 * sig(s, 2.5) - 5.0 * sig(s, 0.5)
    u = robust(0.9, 1.1, 1.0, 12.0, 2.2, dq, tau0 + tau1)
    return tau0 + tau1 - u * unit(s, layer), s, u


def nftsmc(q, dq, qd, dqd, ddqd, matrices, layer):
    """[7] with Table 2."""
    G1, G2, M1, M2 = np.diag([2.0] * 3), np.diag([5 / 3] * 3), 2.0, 2.0
    M0, C0, G0 = matrices(q, dq)
    e, de = q - qd, dq - dqd
    s = e + sig(e, 2.0) + sig(de, 5 / 3)
    known = 12.0 + 2.2 * np.linalg.norm(q) + 2.8 * np.linalg.norm(dq) ** 2
    eta = np.linalg.norm(np.linalg.inv(M0), ord=2) * known
    inner = np.linalg.inv(G2) @ (np.eye(3) + G1 @ np.diag(np.abs(e) ** 1.0)) @ sig(de, 2 - 5 / 3)
    tau = C0 @ dq + G0 + M0 @ (ddqd - inner - M2 * s - (eta + M1) * unit(s, layer))
    return tau, s, eta + M1


def anftsmc(q, dq, qd, dqd, ddqd, matrices, b):
    """[10] with Table 2 and α = 2; also the rate of the adapted gains."""
    k1, k2, alpha, beta, eta, k, lam = 1.0, 1.0, 2.0, 5 / 3, 0.5, 250.0, 0.01
    M0, C0, G0 = matrices(q, dq)
    e, de = q - qd, dq - dqd
    s = e + k1 * sig(e, alpha) + k2 * sig(de, beta)
    sizes = np.array([1.0, np.linalg.norm(q), np.linalg.norm(dq) ** 2])
    size = b @ sizes + eta
    inner = (1 + k1 * alpha * np.abs(e) ** (alpha - 1)) * sig(de, 2 - beta) / (k2 * beta)
    tau = C0 @ dq + G0 + M0 @ (ddqd - inner - k * s - size * np.sign(s))
    drive = sum(abs(s[i]) * abs(de[i]) ** (beta - 1) for i in range(3))
    return tau, s, size, lam * drive * sizes


def slotine_li(q, dq, qd, dqd, ddqd, matrices, layer):
    """The textbook's law with the gains of `slotine_li_4_1`."""
    M0, C0, G0 = matrices(q, dq)
    Lam, KD, K = 5.0 * np.eye(2), np.diag([20.0, 10.0]), np.array([20.0, 15.0])
    e, de = q - qd, dq - dqd
    dq_r, ddq_r = dqd - Lam @ e, ddqd - Lam @ de
    s = dq - dq_r
    sat = np.array([np.sign(x) if abs(x) > layer else x / layer for x in s]) if layer else np.sign(s)
    return M0 @ ddq_r + C0 @ dq_r + G0 - KD @ s - K * sat, s


def super_twisting(q, dq, qd, dqd, ddqd, matrices, v):
    """Super-twisting with the gains of `super_twisting_4_2`; also the rate of v."""
    M0, C0, G0 = matrices(q, dq)
    e, de = q - qd, dq - dqd
    s = de + 5.0 * e
    k1, k2 = np.array([10.0, 12.0, 11.0]), 70.0
    tau = M0 @ (ddqd - 5.0 * de - k1 * np.sqrt(np.abs(s)) * np.sign(s) + v) + C0 @ dq + G0
    return tau, s, -k2 * np.sign(s)
