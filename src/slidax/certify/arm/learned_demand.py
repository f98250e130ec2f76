"""Demand on a law that learns rotor inertia and friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.law.joint_learning import JointLearning
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..certificate import Assumption
from ..sampled_scenario import Floats
from .arm_motion import (
    INSTANTS,
    NominalModel,
    StateSequence,
    breakpoints,
    disturbance_torque,
    friction_torque,
    inertia_ratios,
    outer_torque,
    rigid_body_torque,
)
from .deviation_bound import DeviationBound, deviation_bound
from .hull import Hull, convex_hull
from .members import Members

PROBES = 97
"""Number of instants of the motion at which the degrees of a disturbance's values are found."""

MOST_ARMS = 16
"""Largest number of members at ends of the set in inertia, each with its own learned model."""


@dataclass(frozen=True)
class SetDemand:
    """The demand of a set on the loops; `Demand` explains the fields that are not listed here.

    - `arms`: number of members at which κ was evaluated.
    - `lacking`: bounds of `|1 - M̂⁻¹M|` along the motion [N n n].
    - `held`: bound of the error by holding the model's torque for a period [N n], rad/s² or m/s².
    - `beliefs`: possible models of the law.
    - `relearning`: steps of ŵ from sample to sample when M̂ changes [N n], rad/s² or m/s²; None if it never does.
    - `matrices`: K of some members at some instants [I n n].
    """

    disturbance: Floats
    effects: Floats
    kappa: Floats
    coupling: Floats
    deviation: DeviationBound
    arms: int
    lacking: Floats
    held: Floats
    beliefs: Sequence[NominalModel]
    relearning: Floats | None
    matrices: Floats
    assumptions: Sequence[Assumption]

    @property
    def largest(self) -> Floats:
        """Bound of |w*| [N n], rad/s² or m/s²."""
        return (np.abs(self.disturbance) + np.abs(self.effects).sum(axis=1)).max(axis=0)


def learns_inertia(scenario: Scenario) -> bool:
    """Return True if the law learns the inertia of its joints."""
    law = scenario.controller
    return isinstance(law, SampledData) and isinstance(law.adaptation, JointLearning)


def demand_after_learning(
    members: Members, belief: NominalModel, hull: Hull, plants: list[Plant], motion: StateSequence
) -> SetDemand:
    """Return the demand for models that have learned the mean of M_ii along the motion as M̂_ii, and the true friction.

    `M̂⁻¹` is not linear in the uncertain values, so it is not proved that members between the set's ends demand less.

    - `belief`: the law's initial model.
    - `hull`, `plants`: the hull of the set, and the arms of its points.
    """
    points = members.ends(hull.without, MOST_ARMS)
    arms = members.plants(points)
    beliefs = [learned_model(members.scenario, belief, arm, motion) for arm in arms]
    free = [k for k in range(len(members.axes)) if not members.is_inertial(k)]

    def with_compensation(arms: list[Plant]) -> Floats:
        learned = [learned_model(members.scenario, belief, arm, motion) for arm in arms]
        compensated = np.array([model.friction(motion.t, motion.wanted_dq) for model in learned])
        return outer_torque(arms, motion) + compensated

    def at(shares: Floats) -> list[Plant]:
        full = np.full((len(shares), len(members.axes)), 0.5)
        full[:, free] = shares
        return members.plants(full)

    few = motion.every(64)
    outer_hull = convex_hull(lambda shares: outer_torque(at(shares), few).reshape(len(shares), -1), len(free))
    outer_corners, outer_effects = outer_hull.of(with_compensation(at(outer_hull.points)))
    disturbance, effects, lacking = [], [], np.zeros((*motion.q.shape, motion.joints))
    for arm, model in zip(arms, beliefs, strict=True):
        mass, bias = model.mass_and_bias(motion.t, motion.q, motion.dq)
        masses, torques = rigid_body_torque([arm], motion)
        residual = np.einsum("kij,kj->ki", mass, motion.ddq) + bias - torques[0]
        lacking = np.maximum(lacking, np.abs(np.eye(motion.joints) - np.linalg.solve(mass, masses[0])))
        disturbance.append(np.linalg.solve(mass[None], (residual + outer_corners)[..., None])[..., 0])
        effect = np.linalg.solve(mass[None], outer_effects[..., None])[..., 0] if len(outer_effects) else outer_effects
        effects += [effect] * len(outer_corners)
    kappa, coupling, matrices = inertia_ratios(arms, beliefs, motion)
    disturbances = np.concatenate(disturbance)
    largest = (np.abs(disturbances) + np.abs(np.array(effects)).sum(axis=1)).max(axis=0)
    learned_text = (
        "the law has learned each joint's mean inertia along the motion and its Coulomb friction, within its learning "
        "limits"
    )
    tested_text = f"the set between its ends in inertia: {len(arms)} members were evaluated"
    return SetDemand(
        disturbance=disturbances,
        effects=np.array(effects),
        kappa=kappa,
        coupling=coupling,
        deviation=deviation_bound(belief, motion, plants, hull, largest[None], beliefs),
        arms=len(arms),
        lacking=lacking,
        held=np.array([held_torque_error(model, motion, largest) for model in beliefs]).max(axis=0),
        beliefs=beliefs,
        relearning=None,
        matrices=matrices,
        assumptions=[Assumption(learned_text, "assumed"), Assumption(tested_text, "tested")],
    )


def held_torque_error(belief: NominalModel, motion: StateSequence, disturbance: Floats) -> Floats:
    """Return `|M̂⁻¹ Δ(M̂ (q̈ - w*) + C0 q̇ + G0 + F̂)|` from each sample to the next [N n], the error by a held torque.

    - `disturbance`: bounds of |w*| [N n], which the torque compensates.
    """
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    bias = bias + belief.friction(motion.t, motion.wanted_dq)
    change = np.einsum("kij,kj->ki", np.diff(mass, axis=0), motion.ddq[:-1]) + np.diff(bias, axis=0)
    bound = np.zeros_like(bias)
    bound[:-1] = np.abs(np.linalg.solve(mass[:-1], change[..., None])[..., 0])
    mass_change = np.abs(np.linalg.solve(mass[:-1], np.diff(mass, axis=0)))
    bound[:-1] += np.einsum("kij,kj->ki", mass_change, disturbance[:-1])
    bound[-1] = bound[-2]
    return bound


def demand_of_cases(
    members: Members,
    cases: Sequence[tuple[Plant, NominalModel]],
    belief: NominalModel,
    hull: Hull,
    plants: list[Plant],
    motion: StateSequence,
) -> SetDemand:
    """Return the demand of simulated arms, each with its learned model at each time.

    Each of these arms is combined with every disturbance of the set.

    - `cases`: the arms and their models.
    - `belief`: the law's initial model.
    - `hull`, `plants`: the hull of the set, and the arms of its points, for deviations from the motion.
    """
    lacking = np.zeros((*motion.q.shape, motion.joints))
    initial_mass, bias = belief.at_first(motion.t, motion.q, motion.dq)
    free, outer_hull, outer_corners, outer_effects = _disturbance_hull(members, motion)
    disturbance, effects = [], []
    for arm, model in cases:
        mass = model.learnt(initial_mass, motion.t)
        masses, torques = rigid_body_torque([arm], motion)
        nominal = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + model.friction(motion.t, motion.wanted_dq)
        residual = nominal - torques[0] - friction_torque(arm.robot, motion.dq) + outer_corners
        disturbance.append(np.linalg.solve(mass[None], residual[..., None])[..., 0])
        effect = np.linalg.solve(mass[None], outer_effects[..., None])[..., 0] if len(outer_effects) else outer_effects
        effects.append(effect)
        lacking = np.maximum(lacking, np.abs(np.eye(motion.joints) - np.linalg.solve(mass, masses[0])))
    arms, beliefs = [arm for arm, _ in cases], [model for _, model in cases]
    kappa, coupling, matrices = inertia_ratios(arms, beliefs, motion)
    disturbances = np.concatenate(disturbance)
    all_effects = np.repeat(np.array(effects), len(outer_corners), axis=0)
    largest: Floats = (np.abs(disturbances) + np.abs(all_effects).sum(axis=1)).max(axis=0)
    simulated = [k for k in range(len(members.axes)) if k not in free]
    listed = [
        Assumption(
            f"the law learns, so the bounds are for {len(cases)} simulated arms of the set, each with the rotor "
            f"inertias and friction learned at each time{', for ' + members.named(simulated) if simulated else ''}",
            "tested",
            float(len(cases)),
        )
    ]
    if free:
        listed.append(
            Assumption(
                f"{members.named(free)}: all values, on each of these arms, by "
                f"{len(outer_corners)} computed disturbances and {len(outer_effects)} linear parts",
                "tested",
                float(len(free)),
            )
        )
    if outer_hull.sampled:
        listed.append(Assumption(f"{len(outer_hull.sampled)} of these numbers at 5 values each", "tested"))
    return SetDemand(
        disturbance=disturbances,
        effects=all_effects,
        kappa=kappa,
        coupling=coupling,
        deviation=deviation_bound(belief, motion, plants, hull, largest[None], beliefs),
        arms=len(arms),
        lacking=lacking,
        held=np.array([held_torque_error(model, motion, largest) for model in beliefs]).max(axis=0),
        beliefs=beliefs,
        relearning=np.array([_relearning_step(model, motion, largest) for model in beliefs]).max(axis=0),
        matrices=matrices,
        assumptions=listed,
    )


def _disturbance_hull(members: Members, motion: StateSequence) -> tuple[list[int], Hull, Floats, Floats]:
    """Return the axes of the disturbance, their hull, and its corners [C N n] and effects [E N n] of τ_d."""
    free = members.disturbance_axes

    def at(shares: Floats) -> list[Plant]:
        full = np.full((len(shares), len(members.axes)), 0.5)
        full[:, free] = shares
        return members.plants(full)

    def probes(shares: Floats) -> Floats:
        arms = at(shares)
        few = motion.at(np.union1d(breakpoints(arms, motion.t[-1]), members.brief_force_times), instants=PROBES)
        return disturbance_torque(arms, few).reshape(len(shares), -1)

    hull = convex_hull(probes, len(free))
    corners, effects = hull.of(disturbance_torque(at(hull.points), motion))
    return free, hull, corners, effects


def _relearning_step(belief: NominalModel, motion: StateSequence, disturbance: Floats) -> Floats:
    """Return `|M̂⁻¹ ΔM̂ ŵ|` from each sample to the next [N n], where ΔM̂ was learned in between."""
    rotor = belief.rotor_at(motion.t)
    step = np.abs(np.diff(rotor, axis=0, prepend=rotor[:1])) * disturbance
    mass, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.einsum("kij,kj->ki", np.abs(np.linalg.inv(mass)), step)


def learned_ratios(scenario: Scenario) -> Floats:
    """Return K with learned models at instants of the motion [I n n].

    The model of the scenario's own arm is the one learned in a run; those of members at ends of the set have each
    joint's mean inertia.
    """
    members, motion = Members.of(scenario), StateSequence.of(scenario)
    belief = NominalModel.of(scenario, members.plant)
    run = scenario.replace(outside="recover").simulate(log_every=max(1, len(motion.t) // INSTANTS), progress=False)
    log = run.log
    assert log is not None
    valid = np.asarray(log.valid)
    rotor, coulomb = (np.asarray(log.signals[name])[valid] for name in ("rotor", "coulomb"))
    own = replace(belief, rotor=rotor, coulomb=coulomb, times=np.asarray(log.t)[valid])
    arms = members.plants(members.ends(most=MOST_ARMS))
    matrices = [inertia_ratios([members.plant], [own], motion, INSTANTS)[2]]
    matrices.append(inertia_ratios(arms, [learned_model(scenario, belief, arm, motion) for arm in arms], motion)[2])
    return np.concatenate(matrices)


def learned_model(scenario: Scenario, belief: NominalModel, plant: Plant, motion: StateSequence) -> NominalModel:
    """Return the model that a law has learned for a member along a motion.

    - `belief`: the law's initial model.
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
