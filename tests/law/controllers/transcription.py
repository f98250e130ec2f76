"""Equations (40)-(45), (51) in plain NumPy, written from the paper's text and sharing no line with the package."""

from __future__ import annotations

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
