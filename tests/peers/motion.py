"""Dynamics of an arm in random states by slidax, for comparison with peers."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import numpy as np

from slidax.arms import Articulated
from slidax.core.types import State

WITHIN = 1e-10
"""Largest error, as a share of the norm in each state."""


class States(NamedTuple):
    """Positions, velocities and torques of an arm, [k n] each."""

    q: np.ndarray
    dq: np.ndarray
    tau: np.ndarray


class Motion(NamedTuple):
    """The compared quantities: M [k n n], C q̇ + G, G, q̈ [k n], the tip's place [k 3] and axes [k 3 3]."""

    mass: np.ndarray
    bias: np.ndarray
    gravity: np.ndarray
    acceleration: np.ndarray
    tip: np.ndarray
    tip_axes: np.ndarray


def random_states(robot: Articulated, count: int) -> States:
    """Positions within the limits and within [-π, π], with random velocities and torques."""
    rng, n = np.random.default_rng(11), robot.joints
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    return States(
        rng.uniform(lower, upper, (count, n)), rng.normal(size=(count, n)), rng.normal(size=(count, n)) * 10.0
    )


def _motion(robot: Articulated, q: Any, dq: Any, tau: Any) -> Motion:
    axes, tip = robot.tip_frame(q)
    # Friction is excluded from the comparison: peers smooth it differently.
    acceleration = robot.acceleration(State(q=q, dq=dq), tau + robot.friction(dq))
    return Motion(robot.mass(q), robot.bias(q, dq), robot.gravity(q), acceleration, tip, axes)


# Optimising the program would take three times as long as running it.
_motions = jax.jit(jax.vmap(_motion, (None, 0, 0, 0)), compiler_options={"xla_backend_optimization_level": 0})


def by_slidax(robot: Articulated, states: States) -> Motion:
    """Dynamics by slidax, without names, so that arms with equal numbers of joints share a compilation."""
    numbers = tuple(str(i) for i in range(robot.joints))
    nameless = dataclasses.replace(robot, name="arm", joint_names=numbers, link_names=numbers)
    return Motion(*(np.asarray(part) for part in _motions(nameless, *states)))


def assert_same(ours: Motion, theirs: Motion) -> None:
    """Check that all quantities agree by their norms in each state."""
    for name, mine, other in zip(Motion._fields, ours, theirs, strict=True):
        norm = np.linalg.norm(other.reshape(len(other), -1), axis=1)
        error = np.linalg.norm((mine - other).reshape(len(other), -1), axis=1)
        # A vertical arm has no gravity torques; then both must be nearly zero.
        share = np.max(error / np.maximum(norm, 1e-3))
        assert share <= WITHIN, f"{name}: {share:.1e}"
