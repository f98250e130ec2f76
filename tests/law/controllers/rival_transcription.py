"""The rivals' laws in plain NumPy, written from their equations and sharing no line with the package.

Each takes the state, the reference and `matrices(q, dq)`, which gives M0, C0, G0, and returns τ, s and more.
"""

from __future__ import annotations

import numpy as np


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
