"""Logs of arms whose parameters are known, without a simulation: the torque of a given motion."""

import equinox as eqx
import numpy as np

from slidax.arms import Articulated, Payload, ur5e
from slidax.core import as_array
from slidax.identify import JointLog
from slidax.identify.excitation import FourierSeries
from slidax.identify.regressor import JointMotion, parameters_of_links, parameters_of_payload, rigid_torque

PAYLOAD = Payload(
    mass=as_array(1.4), center=as_array([0.02, -0.03, 0.08]), inertia=as_array(np.diag([4e-3, 5e-3, 6e-3]))
)


def true_arm() -> Articulated:
    """A UR5e with rotors, friction and a payload."""
    values = ([0.3, 0.3, 0.2, 0.06, 0.05, 0.04], [2.0, 2.5, 1.5, 0.5, 0.4, 0.3], [1.0, 0.8, 0.9, 0.3, 0.2, 0.25])
    arm: Articulated = eqx.tree_at(
        lambda arm: (arm.armature, arm.coulomb, arm.viscous, arm.payload),
        ur5e(),
        (*(as_array(value) for value in values), PAYLOAD),
    )
    return arm


def moved(seconds: float, rate: float, joints: int, seed: int = 3, size: float = 1.5) -> tuple[np.ndarray, JointMotion]:
    """Times and a motion with 5 harmonics of 4 s, at `rate` samples a second."""
    series, points = FourierSeries(4.0, 5), int(seconds * rate)
    once = series.motion(size * series.random(np.random.default_rng(seed), joints), int(4.0 * rate))
    return np.arange(points) / rate, JointMotion(*(np.resize(part, (points, joints)) for part in once))


def recorded(
    arm: Articulated,
    *,
    seconds: float = 10.0,
    rate: float = 250.0,
    noise: float = 0.01,
    seed: int = 0,
    offset: float = 0.0,
    lag: float = 0.0,
    still: tuple[int, ...] = (),
    times_and_motion: tuple[np.ndarray, JointMotion] | None = None,
) -> JointLog:
    """Return a log with positions rounded to 1e-5, and torques with noise, a share of their root mean square.

    The joints in `still` do not move.
    """
    t, motion = times_and_motion or moved(seconds, rate, arm.joints)
    for joint in still:
        for part in motion:
            part[:, joint] = 0.0
    torque = rigid_torque(arm, motion, parameters_of_links(arm), parameters_of_payload(arm.payload))
    torque = torque + motion.ddq * np.asarray(arm.armature) + motion.dq * np.asarray(arm.viscous)
    torque = torque + np.sign(motion.dq) * np.asarray(arm.coulomb) + offset
    torque = np.stack([np.interp(t - lag, t, column) for column in torque.T], axis=1)
    size = noise * np.sqrt(np.mean(torque**2, axis=0))
    torque = torque + size * np.random.default_rng(seed).normal(size=torque.shape)
    return JointLog("a test", arm.joint_names, t, 1e-5 * np.round(motion.q / 1e-5), torque)
