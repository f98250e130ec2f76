"""A scenario for a robot that carries its own weight."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax.actuators import Actuator, TorqueLimits
from slidax.robots import Articulated
from slidax.scenarios import Scenario
from slidax.simulation import MujocoPlant, Plant

LEAST = 0.1
"""Smallest share of a joint's torque that is left to the law."""

LOOKS = 200
"""Times along the motion at which the gravity torque is evaluated."""


def weight_by_robot(scenario: Scenario, *, rate: float = 0.99) -> Scenario:
    """The same loop on a robot that adds its own gravity torque: law and arm are weightless.

    The law's nominal arm has gravity 0, so that its command contains none; errors of the robot's gravity compensation
    act as a disturbance. Of each joint's torque the law gets what the weight leaves along the motion.

    - `rate`: share of the torque rate that the law uses, so that rounding causes no violation.

    Raises DefinitionError if the arm is not `Articulated`.
    """
    plant = own_plant(scenario)
    arms = [each for each in jax.tree.leaves(scenario.controller, is_leaf=_is_arm) if _is_arm(each)]
    if not isinstance(plant.robot, Articulated):
        raise DefinitionError(
            f"a robot that carries its own weight is an articulated arm, as from `slidax.robots.panda()`; "
            f"`{scenario.name}` has a {type(plant.robot).__name__}"
        )
    limits = _limits(plant)
    weight = np.abs(_weights(scenario, arms[0] if arms else plant.robot)).max(axis=0)
    torque = np.maximum(np.asarray(limits.torque) - weight, LEAST * np.asarray(limits.torque))
    eased = TorqueLimits(torque=jnp.asarray(torque), rate=jnp.asarray(np.asarray(limits.rate) * rate))
    actuator = Actuator(eased) if plant.actuator is None else eqx.tree_at(lambda a: a.limits, plant.actuator, eased)
    weightless: Plant = eqx.tree_at(
        lambda p: p.actuator, _weightless(plant), actuator, is_leaf=lambda leaf: leaf is None
    )
    return scenario.replace(plant=weightless, controller=_weightless(scenario.controller))


def own_plant(scenario: Scenario) -> Plant:
    """The plant that slidax itself integrates."""
    return scenario.plant.own if isinstance(scenario.plant, MujocoPlant) else scenario.plant


def _is_arm(node: Any) -> bool:
    return isinstance(node, Articulated)


def _weightless(tree: Any) -> Any:
    def without(node: Any) -> Any:
        if not _is_arm(node):
            return node
        return eqx.tree_at(lambda arm: arm.gravity_vector, node, jnp.zeros_like(node.gravity_vector))

    return jax.tree.map(without, tree, is_leaf=_is_arm)


def _limits(plant: Plant) -> TorqueLimits:
    """Limits of the scenario's drives, within those of the arm's data sheet."""
    own = TorqueLimits() if plant.actuator is None else plant.actuator.limits
    assert isinstance(plant.robot, Articulated)
    sheet = plant.robot.limits
    return TorqueLimits(torque=jnp.minimum(own.torque, sheet.torque), rate=jnp.minimum(own.rate, sheet.torque_rate))


def _weights(scenario: Scenario, arm: Articulated) -> np.ndarray:
    """Gravity torques along the motion and at its start, by rows."""
    moments = jnp.linspace(0.0, scenario.t1, LOOKS)
    postures = jax.vmap(lambda t: scenario.trajectory.reference(t).q)(moments)
    return np.asarray(jax.vmap(arm.gravity)(jnp.concatenate([postures, scenario.state0.q[None]])))
