"""Adaptation on two joints under known torques."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms import Articulated, Joint, assemble
from slidax.core.types import State
from slidax.law import AbstractAdaptation, ArmLearning, Experience, JointLearning

PERIOD = 1e-3
LINKS = np.array([[0.5, 0.08], [0.08, 0.02]])


def two_links() -> Articulated:
    """An arm of two links in a vertical plane, the second four times lighter."""
    inertia = np.diag([0.002, 0.02, 0.02])
    link: dict[str, Any] = {"kind": "revolute", "axis": np.array([0.0, 1.0, 0.0])}
    upper = Joint(
        "shoulder", parent=None, link="upper", mass=2.0, center=np.array([0.25, 0, 0]), inertia=inertia, **link
    )
    lower = Joint(
        "elbow",
        parent="shoulder",
        link="lower",
        translation=np.array([0.5, 0, 0]),
        mass=0.5,
        center=np.array([0.2, 0, 0]),
        inertia=0.25 * inertia,
        **link,
    )
    return assemble([upper, lower], tip="lower")


ARM = two_links()


def motion(
    torque: Any, rotor: Any, coulomb: Any, weight: Any = 0.0, fine: int = 10, links: Any = LINKS
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of two joints with a constant inertia, `fine` Euler steps in each period."""
    inverse = np.linalg.inv(links + np.diag(np.broadcast_to(rotor, 2)))
    push = np.broadcast_to(weight, np.shape(torque))
    q, dq, positions, velocities = np.zeros(2), np.zeros(2), [], []
    for now, outside in zip(torque, push, strict=True):
        positions.append(q)
        velocities.append(dq)
        for _ in range(fine):
            dq = dq + PERIOD / fine * (inverse @ (now + outside - coulomb * np.tanh(dq / 0.01)))
            q = q + PERIOD / fine * dq
    return np.array(positions), np.array(velocities)


@eqx.filter_jit
def _adapted(adaptation: AbstractAdaptation, positions: Any, velocities: Any, torque: Any, missed: Any) -> Any:
    mass = jnp.asarray(LINKS) + jnp.diag(jnp.broadcast_to(adaptation.counted, 2))

    def sample(memory: Any, inputs: Any) -> Any:
        q, dq, tau, gap = inputs
        bias = jnp.zeros(2)
        experience = Experience(
            q=q, dq=dq, tau=tau, mass=mass, bias=bias, period=jnp.asarray(PERIOD), missed=gap, nominal=ARM
        )
        memory = adaptation(experience, memory)
        return memory, adaptation.learnt(memory)

    first = adaptation.init(State(q=positions[0], dq=velocities[0]))
    return jax.lax.scan(sample, first, (positions, velocities, torque, missed))


def taught(
    adaptation: AbstractAdaptation,
    positions: np.ndarray,
    velocities: np.ndarray,
    torque: np.ndarray,
    missed: Any = False,
) -> Any:
    """The final memory, and the learnt parameters at each sample.

    The torque of sample k acts from k to k + 1, so each sample measures the effect of the torque before.
    """
    acted = np.vstack([torque[:1] * 0.0, torque[:-1]])
    gaps = np.broadcast_to(missed, len(positions))
    return _adapted(adaptation, *(jnp.asarray(x) for x in (positions, velocities, acted, gaps)))


def swept(amplitude: float, seconds: float = 2.0) -> np.ndarray:
    """Torques of several frequencies from 15 to 120 rad/s on both joints, [k 2]."""
    t = np.arange(int(seconds / PERIOD)) * PERIOD
    first = sum(np.sin(w * t + w) for w in (17.0, 43.0, 97.0))
    second = sum(np.sin(w * t + 2 * w) for w in (23.0, 61.0, 113.0))
    return amplitude * np.stack([8.0 * first, first * 0.0 + second], axis=1)


@eqx.filter_jit
def after_sample(adaptation, experience, memory):
    """Memory of an adaptation after a sample."""
    return adaptation(experience, memory)


def learner(**changes):
    return ArmLearning(joints=JointLearning(rotor=0.1, rotor_max=2.0, coulomb_max=3.0), **changes)
