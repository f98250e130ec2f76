"""The model of a law that learns rotor inertia and friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.law.joint_learning import JointLearning
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from .arm_motion import NominalModel, StateSequence, rigid_body_torque


def learns_inertia(scenario: Scenario) -> bool:
    """Return True if the law learns the inertia of its joints."""
    law = scenario.controller
    return isinstance(law, SampledData) and isinstance(law.adaptation, JointLearning)


def learned_model(scenario: Scenario, belief: NominalModel, plant: Plant, motion: StateSequence) -> NominalModel:
    """Return the model that a law is assumed to have learned for a true arm along a motion.

    Each joint has the true arm's mean inertia along the motion and its Coulomb friction, within the limits of learning.

    - `belief`: the law's initial model. `plant`: the true arm, a member of the set.
    """
    law = scenario.controller
    assert isinstance(law, SampledData)
    assert isinstance(law.adaptation, JointLearning)
    assert belief.counted is not None
    learning, few = law.adaptation, motion.every(64)
    initial = np.diagonal(belief.at_first(few.t, few.q, few.dq)[0], axis1=1, axis2=2).mean(axis=0)
    true = np.diagonal(rigid_body_torque([plant], few)[0][0], axis1=1, axis2=2).mean(axis=0)
    links = initial - belief.counted
    rotor = np.clip(
        belief.counted + true - initial,
        np.asarray(learning.rotor_min) - 0.6 * links,
        np.asarray(learning.rotor_max) + links,
    )
    coulomb = np.asarray(plant.robot.coulomb) if isinstance(plant.robot, Articulated | Coupled) else np.zeros_like(true)
    return replace(belief, rotor=rotor, coulomb=np.clip(coulomb, 0.0, np.asarray(learning.coulomb_max)))
