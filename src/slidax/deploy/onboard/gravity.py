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
"""Share of a joint's torque that is left to a law in any case."""

LOOKS = 200
"""Moments of the motion at which the weight is looked at."""


def weight_by_robot(scenario: Scenario, *, rate: float = 0.99) -> Scenario:
    """The same loop on a robot that adds its own gravity torque: neither law nor arm has any weight left.

    The law's nominal arm gets gravity 0, so that its command has no gravity in it; what the robot compensates wrongly
    is a disturbance to the law. Of each joint's torque the law gets what the weight leaves it along the motion.

    - `scenario`: with an `Articulated` arm.
    - `rate`: share of the torque's rate that the law uses, so that rounding on the way is no violation.

    Raises DefinitionError if the arm is of another kind.
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
    """The plant that we move ourselves.

    - `scenario`: whose.
    """
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
    """Of the drives as the scenario has them, within those of the arm's data sheet."""
    own = TorqueLimits() if plant.actuator is None else plant.actuator.limits
    assert isinstance(plant.robot, Articulated)
    sheet = plant.robot.limits
    return TorqueLimits(torque=jnp.minimum(own.torque, sheet.torque), rate=jnp.minimum(own.rate, sheet.torque_rate))


def _weights(scenario: Scenario, arm: Articulated) -> np.ndarray:
    """The weight's torques at moments of the motion and at its start, by rows."""
    moments = jnp.linspace(0.0, scenario.t1, LOOKS)
    postures = jax.vmap(lambda t: scenario.trajectory.reference(t).q)(moments)
    return np.asarray(jax.vmap(arm.gravity)(jnp.concatenate([postures, scenario.state0.q[None]])))
