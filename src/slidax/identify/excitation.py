"""Excitation motions: Fourier series within the arm's limits, chosen by D-optimality."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slidax.arms.arm import JointLimits, Payload
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError, each_of
from slidax.core.joint_names import joint_label
from slidax.core.writing import error_reason, write_text

from .regressor import (
    BODY,
    JointMotion,
    links_regressor,
    parameters_of_links,
    parameters_of_payload,
    payload_regressor,
    rigid_torque,
)
from .unknowns import REACH

LIMITS = ("range", "velocity", "acceleration", "torque")
"""The limits whose shares an excitation reports."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """An excitation motion from rest to rest, as a table.

    - `joints`: names of the joints.
    - `t`: times [k], s.
    - `motion`: positions, velocities and accelerations at these times.
    - `share`: largest share that each joint uses of its position range, velocity, acceleration and torque limit [4 n].
    - `information`: `½ log₂ det(1 + S A S)`, the information in bits that a log of the motion adds to the prior. A is
      the log's information matrix, S the diagonal matrix of the parameters' prior standard deviations.
    """

    joints: tuple[str, ...]
    t: np.ndarray
    motion: JointMotion
    share: np.ndarray
    information: float

    def as_json(self) -> dict[str, Any]:
        """The output of `slidax excite --json`."""
        return {
            "joints": list(self.joints),
            "duration": float(self.t[-1]),
            "start": self.motion.q[0].tolist(),
            "share": dict(zip(LIMITS, self.share.tolist(), strict=True)),
            "information": self.information,
        }

    def __str__(self) -> str:
        width = max(map(len, self.joints))
        amount = f"{self.information:.0f} bits of information"
        lines = [f"{self.t[-1]:g} s from rest to rest, {amount}; the largest share of each limit:"]
        lines.append(f"{'':<{width}}  {'  '.join(f'{name:>12}' for name in LIMITS)}  {'start':>9}")
        for joint, name in enumerate(self.joints):
            shares = "  ".join(f"{100 * value:>10.0f} %" for value in self.share[:, joint])
            lines.append(f"{name:<{width}}  {shares}  {self.motion.q[0, joint]:>9.4f}")
        return "\n".join(lines)

    __repr__ = __str__

    def write(self, path: str | Path) -> None:
        """Write the motion as a CSV file that `trajectory: {kind: csv, file: ...}` and `Tabulated.from_csv` read.

        - `path`: the file to write.

        Raises DefinitionError if the file cannot be written.
        """
        names = [*self.joints, *(f"{n}.velocity" for n in self.joints), *(f"{n}.acceleration" for n in self.joints)]
        rows = np.column_stack([self.t, self.motion.q, self.motion.dq, self.motion.ddq])
        lines = [",".join(["time", *names])] + [",".join(f"{value:.10g}" for value in row) for row in rows]
        try:
            write_text(Path(path), "\n".join(lines) + "\n")
        except OSError as error:
            raise DefinitionError(f"cannot write the file `{path}`: {error_reason(error)}") from None


@dataclass(frozen=True)
class FourierSeries:
    """`q(t) = Σ_k a_k cos(kωt) + b_k sin(kωt)`, with velocity and acceleration 0 at t = 0.

    - `period`: 2π/ω [s].
    - `harmonics`: K, the number of harmonics.
    """

    period: float
    harmonics: int

    def random(self, rng: np.random.Generator, joints: int) -> np.ndarray:
        """Return random coefficients [n 2K + 1]: for each joint a, b, and a number that selects the motion's centre.

        - `joints`: n, the number of joints.
        """
        return rng.normal(size=(joints, 2 * self.harmonics + 1))

    def motion(self, coefficients: np.ndarray, points: int) -> JointMotion:
        """Return the series and its derivatives at evenly spaced times of one period, each [points n].

        The coefficients are those of the acceleration's series, so that all harmonics have accelerations of similar
        size. They are projected onto the series of positions with `Σ k b_k = 0` and `Σ k² a_k = 0`: velocity and
        acceleration are 0 at t = 0.

        - `coefficients`: as from `random` [n 2K + 1].
        - `points`: number of times.
        """
        count = np.arange(1, self.harmonics + 1)
        # For coefficients of the acceleration the conditions are Σ a = 0 and Σ b/k = 0.
        a, b = coefficients[:, : self.harmonics], coefficients[:, self.harmonics : 2 * self.harmonics]
        a = a - a.mean(axis=1, keepdims=True)
        b = b - (b @ (1.0 / count))[:, None] / count / np.sum(1.0 / count**2)
        omega = 2.0 * np.pi / self.period
        angle = omega * np.outer(np.arange(points) * self.period / points, count)
        cosine, sine = np.cos(angle), np.sin(angle)
        rate = omega * count
        return JointMotion(
            q=(cosine / rate**2) @ a.T + (sine / rate**2) @ b.T,
            dq=(-sine / rate) @ a.T + (cosine / rate) @ b.T,
            ddq=-cosine @ a.T - sine @ b.T,
        )


POINTS = 100
"""Times per period at which the search evaluates torques."""

STARTS, STEPS = 60, 400
"""Number of random motions from which the search chooses its start, and of random changes that it then tries."""

TORQUE_SHARE = 0.97
"""Share of the allowed torque that the search uses: between its `POINTS` times the torque can be slightly larger."""

NOISE = 0.01
"""Assumed noise of a measured torque, as a share of the joint's torque limit."""

ACCELERATION_PER_SPEED = 3.0
"""Default acceleration limit over the velocity limit, 1/s."""

UNLIMITED_ANGLE, UNLIMITED_SPEED, UNLIMITED_TORQUE = 1.5, 1.5, 50.0
"""Limits assumed where the arm has none: rad about 0, rad/s, N m."""


class ExcitationSearch:
    """Random search for the most informative excitation motion within the limits.

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
        self.lower = np.where(np.isfinite(lower), lower, -UNLIMITED_ANGLE)
        self.upper = np.where(np.isfinite(upper), upper, UNLIMITED_ANGLE)
        if center is None:
            # A joint with unlimited rotation moves near 0, as all others do if their range allows it.
            self.lower, self.upper = np.maximum(self.lower, -np.pi), np.minimum(self.upper, np.pi)
        elif (outside := (center < self.lower) | (center > self.upper)).any():
            k = int(np.argmax(outside))
            raise DefinitionError(
                f"`center` must be within the joints' limits; {joint_label(robot.joint_names[k])} has "
                f"{self.lower[k]:g} to {self.upper[k]:g}, got {center[k]:g}"
            )
        self.velocity = _finite(limits.velocity, UNLIMITED_SPEED)
        self.acceleration = (
            ACCELERATION_PER_SPEED * self.velocity if acceleration is None else acceleration + 0.0 * self.velocity
        )
        self.torque = _finite(limits.torque, UNLIMITED_TORQUE)
        self.robot, self.share, self.links = robot, share, links
        # NumPy arrays: the search reads them many times.
        self.known, self.armature, self.masses = (
            parameters_of_links(robot),
            *map(np.asarray, (robot.armature, robot.masses)),
        )
        self.carried = parameters_of_payload(payload)

    def best(self, series: FourierSeries, rng: np.random.Generator) -> tuple[np.ndarray, float]:
        """Return the best coefficients of a random search [n 2K + 1], and their `score`, in bits.

        - `series`: the Fourier series with K harmonics.
        """
        best, coefficients = -np.inf, series.random(rng, self.robot.joints)
        for _ in range(STARTS):
            candidate = series.random(rng, self.robot.joints)
            score = self.score(self.scaled_motion(series, candidate, POINTS))
            if score > best:
                best, coefficients = score, candidate
        size = 0.5
        for _ in range(STEPS):
            changed = rng.random((self.robot.joints, 1)) < 0.3
            candidate = coefficients + size * series.random(rng, self.robot.joints) * changed
            score = self.score(self.scaled_motion(series, candidate, POINTS))
            if score > best:
                best, coefficients, size = score, candidate, min(1.0, 1.3 * size)
            else:
                size = max(0.02, 0.97 * size)
        return coefficients, best

    def scaled_motion(self, series: FourierSeries, coefficients: np.ndarray, points: int) -> JointMotion:
        """Return the motion over one period, each joint scaled to its limits.

        - `series`, `coefficients`: the shape of the motion.
        - `points`: number of times.
        """
        shape, speed, change = series.motion(coefficients, points)
        low, high = shape.min(axis=0), shape.max(axis=0)
        half = 0.5 * self.share * (self.upper - self.lower)
        middle = 0.5 * (self.upper + self.lower)
        if self.center is None:
            range_factor = 2.0 * half / np.maximum(high - low, 1e-9)
        else:
            middle = self.center
            inside = self.share * np.minimum(self.upper - middle, middle - self.lower)
            range_factor = inside / np.maximum(np.maximum(high, -low), 1e-9)
        factor = np.minimum.reduce(
            [
                range_factor,
                self.share * self.velocity / np.maximum(np.abs(speed).max(axis=0), 1e-9),
                self.share * self.acceleration / np.maximum(np.abs(change).max(axis=0), 1e-9),
            ]
        )
        if self.center is None:
            # The last coefficient selects a centre for which the motion stays inside the limits.
            free = np.maximum(half - 0.5 * factor * (high - low), 0.0)
            middle = middle - 0.5 * factor * (high + low) + free * np.tanh(coefficients[:, -1])
        return JointMotion(middle + factor * shape, factor * speed, factor * change)

    def torque_share(self, motion: JointMotion) -> np.ndarray:
        """Return each joint's largest torque relative to the allowed torque, `share` times its limit, [n]."""
        torque = self._torque(motion)
        return np.abs(torque).max(axis=0) / (self.share * self.torque)

    def score(self, motion: JointMotion) -> float:
        """Return the motion's information in bits, less a penalty for torques beyond their limits."""
        n = self.robot.joints
        weigh = max(float(np.sum(self.masses)), 0.1)
        if self.links:
            bodies = links_regressor(self.robot, motion)
            sizes = [max(0.5 * float(mass), 0.01 * weigh) * _BODY for mass in self.masses]
        else:
            bodies, sizes = payload_regressor(self.robot, motion), [weigh * _BODY]
        drives = [motion.ddq, np.sign(motion.dq), motion.dq, np.ones_like(motion.dq)]
        units = [self.acceleration, np.ones(n), self.velocity, np.ones(n)]
        columns = np.concatenate([bodies, *(drive[:, :, None] * np.eye(n) for drive in drives)], axis=2)
        scale = np.concatenate([*sizes, *(self.torque / unit for unit in units)])
        scaled = columns * scale / (NOISE * self.torque[:, None])
        flat = scaled.reshape(-1, scaled.shape[2])
        _, size = np.linalg.slogdet(np.eye(len(scale)) + flat.T @ flat)
        # A weight that no gain in information can outweigh.
        over = np.maximum(self.torque_share(motion) - TORQUE_SHARE, 0.0).sum()
        return float(0.5 * size / np.log(2.0) - 1000.0 * over)

    def shares(self, motion: JointMotion) -> np.ndarray:
        """Return the largest share of each limit that the motion uses, [4 n], in the order of `LIMITS`."""
        return np.stack(
            [
                (motion.q.max(axis=0) - motion.q.min(axis=0)) / (self.upper - self.lower),
                np.abs(motion.dq).max(axis=0) / self.velocity,
                np.abs(motion.ddq).max(axis=0) / self.acceleration,
                self.torque_share(motion) * self.share,
            ]
        )

    def _torque(self, motion: JointMotion) -> np.ndarray:
        return rigid_torque(self.robot, motion, self.known, self.carried) + motion.ddq * self.armature


_BODY = np.array([1.0, *3 * (REACH,), *6 * (REACH**2,)])
assert len(_BODY) == BODY


def _finite(limit: object, otherwise: float) -> np.ndarray:
    values = np.asarray(limit)
    return np.where(np.isfinite(values), values, otherwise)


def excite(
    robot: Articulated,
    *,
    seed: int,
    duration: float = 20.0,
    harmonics: int = 10,
    share: float = 0.8,
    acceleration: float | None = None,
    center: np.ndarray | None = None,
    payload: Payload | None = None,
    links: bool = False,
    rate: float = 50.0,
) -> Excitation:
    """Design an excitation motion: a Fourier series per joint, within limits, whose log is the most informative.

    Joint j moves by `q_j(t) = c_j + Σ_k a_jk cos(kωt) + b_jk sin(kωt)` (Swevers et al., *Optimal robot excitation and
    identification*, 1997) over two periods 2π/ω, with velocity and acceleration 0 at the start and at the end. Each
    joint's series is scaled until it reaches `share` of its position range, velocity or acceleration limit. The search
    takes the best of many random series and improves it by random changes. Its criterion is D-optimality: the largest
    determinant of the scaled parameters' information matrix. The search does not check for collisions of the arm with
    itself or with its surroundings.

    - `robot`: the arm, with its limits.
    - `seed`: seed of the random numbers; the same seed gives the same motion.
    - `duration`: duration of both periods together [s].
    - `harmonics`: number of harmonics, at least 3.
    - `share`: largest share of each limit to use, in (0, 1].
    - `acceleration`: acceleration limit [rad/s² or m/s²]; by default three times the velocity limit, per second.
    - `center`: positions about which to move [n]; chosen within the limits by default.
    - `payload`: largest payload for which the torque limits must hold; the robot's own by default.
    - `links`: True to excite the links' inertial parameters as well.
    - `rate`: rows per second in the table.

    Raises DefinitionError if a number is out of its range, or no motion keeps the torque limits.
    """
    for name, value, holds, rule in (
        ("duration", duration, 1.0 <= duration <= 600.0, "in [1, 600] s"),
        ("harmonics", harmonics, 3 <= harmonics <= 50, "in [3, 50]: rest at both ends takes two"),
        ("share", share, 0.0 < share <= 1.0, "in (0, 1]"),
        ("rate", rate, 5.0 <= rate <= 1000.0, "in [5, 1000] Hz"),
        ("acceleration", acceleration, acceleration is None or 0.0 < acceleration < np.inf, "> 0 and finite"),
    ):
        if not holds:
            raise DefinitionError(f"`{name}` of an excitation motion must be {rule}; got {value}")
    if center is not None and np.shape(center) != (robot.joints,):
        raise DefinitionError(f"`center` must have one position for {each_of(robot.joints, 'joint')}; got {center}")
    search = ExcitationSearch(robot, share, acceleration, center, payload or robot.payload, links)
    rng = np.random.default_rng(seed)
    series = FourierSeries(duration / 2.0, harmonics)
    # The last scaling uses the times of the table's rows, so that the limits hold in each row.
    rows = max(2, round(duration * rate / 2.0))
    coefficients, best = search.best(series, rng)
    motion = search.scaled_motion(series, coefficients, rows)
    torque = search.torque_share(motion)
    if torque.max() > 1.0 + 1e-9:
        joint = int(np.argmax(torque))
        raise DefinitionError(
            f"no excitation motion found within the torque limit of {joint_label(robot.joint_names[joint])}: the best "
            f"one takes {torque[joint]:.3g} times the allowed torque; give a `center` where the joint carries less, a "
            "larger `share`, or less payload"
        )
    twice = JointMotion(*(np.concatenate([part, part, part[:1]]) for part in motion))
    t = np.arange(2 * rows + 1) * (duration / (2 * rows))
    return Excitation(robot.joint_names, t, twice, search.shares(motion), best)
