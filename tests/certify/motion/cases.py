"""Arms, loops and motions for the tests of bounds along a motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import slidax.arms as arms
from slidax.certify.motion.path_cells import PathCells
from slidax.identify.band import Band, EstimateErrors, arm_parameters, band_of, base_parameters, inertial_regressor
from slidax.identify.mass_bound import MassBound
from slidax.identify.regressor import BODY, JointMotion
from slidax.motions.tabulated import Tabulated
from tests.identify.recorded import moved


def loaded(arm: Any, payload: float) -> Any:
    """The arm with a payload 0.1 m beyond its flange [kg] and rotors of 0.1 kg m²."""
    load, n = arms.Payload(mass=payload, center=[0, 0, 0.1], inertia=0.0025 * payload), arm.joints
    return eqx.tree_at(
        lambda arm: (arm.armature, arm.viscous, arm.payload), arm, (jnp.full(n, 0.1), jnp.full(n, 0.2), load)
    )


def panda(payload: float = 2.0) -> Any:
    return loaded(arms.panda(), payload)


def ur5e(payload: float = 3.0) -> Any:
    return loaded(arms.ur5e(), payload)


@cache
def identified(name: str, p: float = 0.03) -> tuple[Any, Band]:
    """An arm and the band of least squares on 4 s of a motion, scaled to this p."""
    arm = {"panda": panda, "ur5e": ur5e}[name]()
    n, motion = arm.joints, moved(4.0, 250.0, arm.joints, size=2.0)[1]
    drives = [np.sign(motion.dq), motion.dq]
    columns = [inertial_regressor(arm, motion), *(drive[:, :, None] * np.eye(n) for drive in drives)]
    rows = np.concatenate(columns, axis=2)
    theta = np.concatenate([arm_parameters(arm), np.full(n, 0.3), np.asarray(arm.viscous)])
    weighted = rows / np.sqrt(np.mean((rows @ theta) ** 2, axis=0))[:, None]
    unit = np.concatenate([base_parameters(arm)[1], np.ones(2 * n)])
    weighted = 100.0 * weighted.reshape(-1, len(unit)) * unit
    covariance = np.linalg.inv(weighted.T @ weighted + 0.01 * np.eye(len(unit))) * np.outer(unit, unit)
    names = [f"link.{k}" for k in range(BODY)] * n
    names += [kind for kind in ("armature", "coulomb", "viscous") for _ in range(n)]
    joints = [joint for joint in range(n) for _ in range(BODY)] + list(range(n)) * 3
    bodies = tuple(range(0, BODY * n, BODY))
    band = band_of(arm, EstimateErrors(tuple(names), tuple(joints), bodies, theta, covariance))
    return arm, replace(band, p=p, deviations=band.deviations * (p / band.p))


class Members:
    """Torques and inertias of an ellipsoid's axes, by the regressor of `identify`; the rows of D are the last axis."""

    def __init__(self, name: str) -> None:
        self.arm, self.band = identified(name)
        self.bound = MassBound(self.arm, arm_parameters(self.arm))
        self.still = eqx.tree_at(lambda arm: arm.gravity_vector, self.arm, jnp.zeros(3))

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return inertial_regressor(self.arm, JointMotion(q, dq, ddq)) @ self.band.deviations.T

    def inertia(self, q: np.ndarray, parameters: np.ndarray | None = None) -> np.ndarray:
        """E of each axis, or M of some parameters, [N n n r]."""
        nothing = np.zeros_like(q)
        columns = self.band.deviations.T if parameters is None else parameters[:, None]
        units = [JointMotion(q, nothing, nothing + row) for row in np.eye(q.shape[1])]
        return np.stack([inertial_regressor(self.still, motion) @ columns for motion in units], axis=2)

    def admitted(self, shares: np.ndarray) -> np.ndarray:
        """Shares of the axes [s r], made smaller where the relative error of M may pass p."""
        size = self.bound.of(shares @ self.band.deviations)
        return shares * (self.band.p / np.maximum(size, self.band.p))[:, None]

    def nominal(self, q: np.ndarray) -> np.ndarray:
        return self.inertia(q, arm_parameters(self.arm))[..., 0]


def box(arm: Any) -> tuple[np.ndarray, np.ndarray]:
    """Joint range less 0.1 rad, within ± π."""
    lower, upper = np.asarray(arm.limits.lower), np.asarray(arm.limits.upper)
    return np.maximum(lower, -np.pi) + 0.1, np.minimum(upper, np.pi) - 0.1


def quintic(arm: Any, rng: np.random.Generator, share: float, acceleration: float = 10.0) -> Any:
    """Point to point, at rest at both ends, at a share of the largest speeds and accelerations."""
    lower, upper = box(arm)
    ends = rng.uniform(lower, upper, size=(2, arm.joints))
    gone = np.abs(ends[1] - ends[0])
    speed = share * np.asarray(arm.limits.velocity)
    time = max(np.max(1.875 * gone / speed), np.max(np.sqrt(5.7735 * gone / (share * acceleration))))
    return Tabulated.through([0.0, time], ends, np.zeros_like(ends), np.zeros_like(ends))


def knotted(
    arm: Any, rng: np.random.Generator, share: float, acceleration: float = 10.0, most: int | None = None
) -> Any:
    """Like a time-optimal path along two straight stretches with a blend, with at most `most` knots each 0.1 s."""
    lower, upper = box(arm)
    points = rng.uniform(lower, upper, size=(3, arm.joints))
    # A blended polygon by its length, with a trapezoid in time.
    s = np.linspace(0.0, 1.0, 2001)
    polygon = np.stack([np.interp(s, [0.0, 0.5, 1.0], points[:, j]) for j in range(arm.joints)], axis=1)
    width = 401
    kernel = np.hanning(width + 2)[1:-1]
    kernel /= kernel.sum()
    padded = np.concatenate([np.repeat(polygon[:1], width // 2, 0), polygon, np.repeat(polygon[-1:], width // 2, 0)])
    path = np.stack([np.convolve(padded[:, j], kernel, "valid") for j in range(arm.joints)], axis=1)
    first, second = np.gradient(path, s, axis=0), np.gradient(np.gradient(path, s, axis=0), s, axis=0)
    speed, limit = share * np.asarray(arm.limits.velocity), share * acceleration
    rate = np.min(speed / np.maximum(np.abs(first), 1e-9), axis=1)
    rate = np.minimum(rate, np.min(np.sqrt(0.5 * limit / np.maximum(np.abs(second), 1e-9)), axis=1))
    rate[[0, -1]] = 0.0
    push = np.min(0.5 * limit / np.maximum(np.abs(first), 1e-9), axis=1)
    step = s[1] - s[0]
    for _ in range(2):
        for i in range(1, len(s)):
            rate[i] = min(rate[i], np.sqrt(rate[i - 1] ** 2 + 2 * push[i - 1] * step))
        rate = rate[::-1]
        push = push[::-1]
    times = np.concatenate([[0.0], np.cumsum(2 * step / np.maximum(rate[1:] + rate[:-1], 1e-6))])
    count = max(3, int(np.ceil(times[-1] / 0.1)) + 1)
    knots = np.linspace(0.0, times[-1], count if most is None else min(count, most))
    at = np.interp(knots, times, s)
    through = np.stack([np.interp(at, s, path[:, j]) for j in range(arm.joints)], axis=1)
    return Tabulated.through(knots, through, acceleration=200.0)


def still(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, dddq: np.ndarray | None = None) -> PathCells:
    """Cells of zero length at some states."""
    nothing = np.zeros_like(q)
    jerk = nothing if dddq is None else dddq
    return PathCells(1e-9, 1, q, dq, ddq, jerk, np.abs(dq), np.abs(ddq), np.abs(jerk), nothing, nothing, None, None)


def desired(motion: Any, period: float, slots: int, sub: int, delay: int) -> np.ndarray:
    """Positions and velocities at substeps [(slots + delay + 1) sub + 1, 2, n]."""
    from slidax.certify.motion.path_cells import pieces_of

    t = np.arange((slots + delay + 1) * sub + 1) * (period / sub)
    values = pieces_of(motion, float(t[-1])).at(t)
    return np.stack(values[:2], axis=1)
