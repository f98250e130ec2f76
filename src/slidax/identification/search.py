"""The search for a motion that shows an arm's numbers."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Articulated, JointLimits, Payload

from .fourier import Fourier
from .regressor import (
    BODY,
    Motion,
    links_regressor,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .unknowns import REACH

POINTS = 100
"""Times of a period at which torques are looked at during the search."""

STARTS, STEPS = 60, 400
"""Random motions of which the best is taken, and changes of it that are tried."""

ALMOST = 0.97
"""Of the torque that is allowed: between the times that the search looks at there is a little more."""

NOISE = 0.01
"""Of a joint's torque limit: what its torques are taken to be measured to."""

OF_FASTEST = 3.0
"""The largest acceleration, where none is given, over the largest velocity, 1/s."""

UNLIMITED_TURN, UNLIMITED_SPEED, UNLIMITED_TORQUE = 1.5, 1.5, 50.0
"""Limits assumed where the arm has none: rad about 0, rad/s, N m."""


class Search:
    """The information of an excitation motion, and its scaling to the limits.

    - `robot`, `share`, `acceleration`, `center`, `payload`, `links`: as in `excite`.
    """

    def __init__(
        self,
        robot: Articulated,
        share: float,
        acceleration: float | None,
        center: np.ndarray | None,
        payload: Payload,
        links: bool,
    ) -> None:
        limits: JointLimits = robot.limits
        lower, upper = np.asarray(limits.lower), np.asarray(limits.upper)
        self.center = center
        self.lower = np.where(np.isfinite(lower), lower, -UNLIMITED_TURN)
        self.upper = np.where(np.isfinite(upper), upper, UNLIMITED_TURN)
        if center is None:
            # A joint that turns freely begins near 0, as all others do if their range allows it.
            self.lower, self.upper = np.maximum(self.lower, -np.pi), np.minimum(self.upper, np.pi)
        elif ((center < self.lower) | (center > self.upper)).any():
            raise DefinitionError(f"`center` must be within the joints' limits; got {list(center)}")
        self.velocity = _finite(limits.velocity, UNLIMITED_SPEED)
        self.acceleration = OF_FASTEST * self.velocity if acceleration is None else acceleration + 0.0 * self.velocity
        self.torque = _finite(limits.torque, UNLIMITED_TORQUE)
        self.robot, self.share, self.links = robot, share, links
        # Plain numbers: the search asks for them many times.
        self.known, self.armature, self.masses = (
            parameters_of_links(robot),
            *map(np.asarray, (robot.armature, robot.masses)),
        )
        self.carried = parameters_of_payload(payload)

    def best(self, series: Fourier, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """The best coefficients of all that are tried, and what they are worth.

        - `series`: their form.
        """
        best, where = -np.inf, series.random(rng, self.robot.joints)
        for _ in range(STARTS):
            candidate = series.random(rng, self.robot.joints)
            score = self.score(self.fitted(series, candidate, POINTS))
            if score > best:
                best, where = score, candidate
        size = 0.5
        for _ in range(STEPS):
            changed = rng.random((self.robot.joints, 1)) < 0.3
            candidate = where + size * series.random(rng, self.robot.joints) * changed
            score = self.score(self.fitted(series, candidate, POINTS))
            if score > best:
                best, where, size = score, candidate, min(1.0, 1.3 * size)
            else:
                size = max(0.02, 0.97 * size)
        return where, best

    def fitted(self, series: Fourier, coefficients: np.ndarray, points: int) -> Motion:
        """The motion over one period, each joint's as large as its limits allow.

        - `series`, `coefficients`: the motion's form.
        - `points`: at how many times.
        """
        shape, speed, change = series.motion(coefficients, points)
        low, high = shape.min(axis=0), shape.max(axis=0)
        half = 0.5 * self.share * (self.upper - self.lower)
        middle = 0.5 * (self.upper + self.lower)
        if self.center is None:
            room = 2.0 * half / np.maximum(high - low, 1e-9)
        else:
            middle = self.center
            inside = self.share * np.minimum(self.upper - middle, middle - self.lower)
            room = inside / np.maximum(np.maximum(high, -low), 1e-9)
        factor = np.minimum.reduce(
            [
                room,
                self.share * self.velocity / np.maximum(np.abs(speed).max(axis=0), 1e-9),
                self.share * self.acceleration / np.maximum(np.abs(change).max(axis=0), 1e-9),
            ]
        )
        if self.center is None:
            # About any place at which it stays inside: the series' own last number says which.
            free = np.maximum(half - 0.5 * factor * (high - low), 0.0)
            middle = middle - 0.5 * factor * (high + low) + free * np.tanh(coefficients[:, -1])
        return Motion(middle + factor * shape, factor * speed, factor * change)

    def torque_share(self, motion: Motion) -> np.ndarray:
        """The largest torque over what is allowed, [n]."""
        torque = self._torque(motion)
        return np.abs(torque).max(axis=0) / (self.share * self.torque)

    def score(self, motion: Motion) -> float:
        """Bits of information, less what the torque limits are passed by."""
        n = self.robot.joints
        bodies = [payload_regressor(self.robot, motion)]
        weigh = max(float(np.sum(self.masses)), 0.1)
        sizes = [weigh * _BODY]
        if self.links:
            bodies = [links_regressor(self.robot, motion)]
            sizes = [max(0.5 * float(mass), 0.01 * weigh) * _BODY for mass in self.masses]
        else:
            bodies = [payload_regressor(self.robot, motion)]
        drives = [motion.ddq, np.sign(motion.dq), motion.dq, np.ones_like(motion.dq)]
        units = [self.acceleration, np.ones(n), self.velocity, np.ones(n)]
        columns = np.concatenate([*bodies, *(drive[:, :, None] * np.eye(n) for drive in drives)], axis=2)
        scale = np.concatenate([*sizes, *(self.torque / unit for unit in units)])
        scaled = columns * scale / (NOISE * self.torque[:, None])
        flat = scaled.reshape(-1, scaled.shape[2])
        _, size = np.linalg.slogdet(np.eye(len(scale)) + flat.T @ flat)
        # Weighed so that no bits can pay for it.
        over = np.maximum(self.torque_share(motion) - ALMOST, 0.0).sum()
        return float(0.5 * size / np.log(2.0) - 1000.0 * over)

    def shares(self, motion: Motion) -> np.ndarray:
        """The largest share of each limit, [4 n]."""
        return np.stack(
            [
                (motion.q.max(axis=0) - motion.q.min(axis=0)) / (self.upper - self.lower),
                np.abs(motion.dq).max(axis=0) / self.velocity,
                np.abs(motion.ddq).max(axis=0) / self.acceleration,
                self.torque_share(motion) * self.share,
            ]
        )

    def _torque(self, motion: Motion) -> np.ndarray:
        return rigid_torque(self.robot, motion, self.known, self.carried) + motion.ddq * self.armature


_BODY = np.array([1.0, *3 * (REACH,), *6 * (REACH**2,)])
assert len(_BODY) == BODY


def _finite(limit: object, otherwise: float) -> np.ndarray:
    values = np.asarray(limit)
    return np.where(np.isfinite(values), values, otherwise)
