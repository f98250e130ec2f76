"""Logs that are wrong in one way each, as drivers and recorders make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import equinox as eqx
import numpy as np

import slidax as sx
from slidax.arms import Articulated, Payload
from slidax.core import as_array
from slidax.identify import JointLog
from tests.identify.recorded import moved, recorded

Spoil = Callable[[JointLog, np.random.Generator], JointLog]


@dataclass(frozen=True)
class Kind:
    """A way to spoil a log.

    `cause` is a regular expression of the words that name it, in the error or in a warning.
    """

    name: str
    spoil: Spoil
    cause: str
    refused: bool = True


def two_link() -> Articulated:
    """A planar arm that hangs in gravity, with limits as a data sheet has them."""
    path = Path(__file__).parents[2] / "examples" / "robots" / "two_link.urdf"
    return sx.arms.from_urdf(str(path), gravity=(0.0, -9.81, 0.0), armature=[0.3, 0.2])


ARMS: dict[str, Callable[[], Articulated]] = {
    "two_link": two_link,
    "panda": sx.arms.panda,
    "ur5e": sx.arms.ur5e,
}


def with_drives(arm: Articulated, rng: np.random.Generator) -> Articulated:
    """The arm with rotors, friction and a payload by chance."""
    n = arm.joints
    limit = np.asarray(arm.limits.torque)
    rated = np.where(np.isfinite(limit), limit, 50.0)
    true: Articulated = eqx.tree_at(
        lambda robot: (robot.armature, robot.coulomb, robot.viscous, robot.payload),
        arm,
        (
            as_array(2e-3 * rated * rng.uniform(0.5, 2.0, n)),
            as_array(1e-2 * rated * rng.uniform(0.5, 2.0, n)),
            as_array(1e-2 * rated * rng.uniform(0.3, 1.5, n)),
            Payload(mass=as_array(rng.uniform(0.2, 1.5)), center=as_array([0.01, 0.0, 0.05]), inertia=as_array(2e-3)),
        ),
    )
    return true


def clean_log(
    arm: Articulated, seed: int, *, rate: float = 250.0, noise: float = 0.02, velocity: bool = True
) -> JointLog:
    """A log of the arm with drives by chance, on a motion by chance of 16 s."""
    rng = np.random.default_rng(seed)
    motion = moved(16.0, rate, arm.joints, seed=seed, size=1.2)
    log = recorded(with_drives(arm, rng), noise=noise, seed=seed, given=motion)
    if not velocity:
        return log
    dq = motion[1].dq
    return replace(log, dq=dq + 0.01 * np.std(dq, axis=0) * rng.normal(size=dq.shape))


def _factor(joint: int | slice, factor: float) -> Spoil:
    def spoil(log: JointLog, rng: np.random.Generator) -> JointLog:
        tau = log.tau.copy()
        tau[:, joint] *= factor
        return replace(log, tau=tau)

    return spoil


def _interchanged(positions: bool, torques: bool) -> Spoil:
    def spoil(log: JointLog, rng: np.random.Generator) -> JointLog:
        order = np.arange(len(log.joints))
        a, b = (0, 1) if len(order) == 2 else (1, 3)
        order[[a, b]] = order[[b, a]]
        q = log.q[:, order] if positions else log.q
        dq = log.dq if log.dq is None or not positions else log.dq[:, order]
        return replace(log, q=q, dq=dq, tau=log.tau[:, order] if torques else log.tau)

    return spoil


def _late(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=np.stack([np.interp(log.t - 0.3, log.t, column) for column in log.tau.T], axis=1))


def _currents(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=log.tau / rng.uniform(6.0, 15.0, len(log.joints)))


def _constant(log: JointLog, rng: np.random.Generator) -> JointLog:
    tau = log.tau.copy()
    tau[:, 1] = 0.0
    return replace(log, tau=tau)


def _turned(log: JointLog, rng: np.random.Generator) -> JointLog:
    sign = np.ones(len(log.joints))
    sign[1] = -1.0
    return replace(log, q=log.q * sign, dq=None if log.dq is None else log.dq * sign)


def _offset(log: JointLog, rng: np.random.Generator) -> JointLog:
    q = log.q.copy()
    q[:, 1] += 0.5 * np.pi
    return replace(log, q=q)


def _without(log: JointLog) -> np.ndarray:
    return (log.t < 6.0) | (log.t > 8.0)


def _gap(log: JointLog, rng: np.random.Generator) -> JointLog:
    return log.rows(_without(log))


def _lines(log: JointLog, rng: np.random.Generator) -> JointLog:
    keep = _without(log)

    def filled(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(log.t, log.t[keep], column[keep]) for column in values.T], axis=1)

    return replace(log, q=filled(log.q), tau=filled(log.tau), dq=None if log.dq is None else filled(log.dq))


def _set_back(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, t=np.where(log.t > 7.0, log.t - 3.0, log.t))


def _noise(log: JointLog, rng: np.random.Generator) -> JointLog:
    return replace(log, tau=np.std(log.tau, axis=0) * rng.normal(size=log.tau.shape).cumsum(axis=0) / 50.0)


KINDS = (
    Kind("all torques with the opposite sign", _factor(slice(None), -1.0), r"--torque-sign -1`"),
    Kind("one torque with the opposite sign", _factor(1, -1.0), r"--torque-sign 1,-1"),
    Kind("torques of two joints interchanged", _interchanged(False, True), r"--torque-order"),
    Kind("two joints interchanged", _interchanged(True, True), r"--joint-order"),
    Kind("positions of two joints interchanged", _interchanged(True, False), r"--(position|torque)-order"),
    Kind("torques in mN m", _factor(slice(None), 1e3), r"--torque-unit mNm"),
    Kind("one torque in mN m", _factor(1, 1e3), r"--torque-scale 1,0.001"),
    Kind("torques on the motor's side", _factor(slice(None), 0.01), r"--torque-scale ([4-9]\d|1[0-4]\d)(\.\d+)?`"),
    Kind("motor currents", _currents, r"--torque-scale .*,"),
    Kind("torques all 0", _factor(slice(None), 0.0), r"all 0"),
    Kind("one torque all 0", _constant, r"--ignore-torque"),
    Kind("times in ms", lambda log, rng: replace(log, t=1e3 * log.t), r"--time-unit ms"),
    Kind("times in ns", lambda log, rng: replace(log, t=1.7e18 + 1e9 * log.t), r"--time-unit ns"),
    Kind(
        "positions in degrees",
        lambda log, rng: replace(log, q=np.degrees(log.q), dq=None if log.dq is None else np.degrees(log.dq)),
        r"--position-unit deg",
    ),
    Kind("torques 0.3 s late", _late, r"--torque-delay 0\.(29|3)"),
    Kind("one joint counts in the opposite direction", _turned, r"--position-sign 1,-1"),
    Kind("one zero turned by 90°", _offset, r"--position-offset 0,-1\.57"),
    Kind("a gap of 2 s", _gap, r"has a gap, the longest of 2", refused=False),
    Kind("a gap of 2 s that straight lines fill", _lines, r"straight lines for 2", refused=False),
    Kind("a clock that is set back", _set_back, r"clock was set back", refused=False),
    Kind("torques of nothing", _noise, r"varies by|noise alone|do not fit"),
    Kind(
        "positions in revolutions",
        lambda log, rng: replace(log, q=log.q / 2 / np.pi, dq=None if log.dq is None else log.dq / 2 / np.pi),
        r"--position-unit rev",
    ),
)
"""Kinds that spoil the log; `MOUNTED` spoils the arm's file."""

MOUNTED = Kind("an arm mounted at 45°", lambda log, rng: log, r"--gravity")


def mounted(arm: Articulated) -> Articulated:
    """The arm as it is, mounted at 45°: its file says upright."""
    g = np.linalg.norm(np.asarray(arm.gravity_vector)) * np.sqrt(0.5)
    down = (0.0, g, -g) if abs(float(arm.gravity_vector[2])) > 1.0 else (g, -g, 0.0)
    tilted: Articulated = eqx.tree_at(lambda robot: robot.gravity_vector, arm, as_array(down))
    return tilted
