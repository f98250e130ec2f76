"""The demand on a law that learns rotor inertia and friction."""

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
"""Instants of the motion that show how the values of a disturbance enter."""

MOST_ARMS = 16
"""Members at ends of the values that change the inertia, each with a model of its own."""


@dataclass(frozen=True)
class SetDemand:
    """The demand of a set on the loops, with the fields of `Demand`.

    - `arms`: number of members at which κ was evaluated.
    - `lacking`: bounds of `|1 - M̂⁻¹M|` along the motion [N n n].
    - `held`: change of the model's torque within a period in which the torque is held [N n], rad/s² or m/s².
    - `beliefs`: models that the law may have.
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
    """True if the law learns the inertia of its joints."""
    law = scenario.controller
    return isinstance(law, SampledData) and isinstance(law.adaptation, JointLearning)


def demand_after_learning(
    members: Members, belief: NominalModel, hull: Hull, plants: list[Plant], motion: StateSequence
) -> SetDemand:
    """Return the demand once the law's model has `M̂_ii = M_ii`, in the mean along the motion, and the true friction.

    `M̂⁻¹` is not linear in the uncertain values, so members between the set's ends are not proved to demand less.

    - `belief`: the law's initial model.
    - `hull`, `plants`: the hull of the set, and the arms of its points.
    """
    points = members.ends(hull.without, MOST_ARMS)
    arms = members.plants(points)
    beliefs = [learned_model(members.scenario, belief, arm, motion) for arm in arms]
    free = [k for k in range(len(members.axes)) if not members.is_inertial(k)]

    def rubbed(arms: list[Plant]) -> Floats:
        learned = [learned_model(members.scenario, belief, arm, motion) for arm in arms]
        compensated = np.array([arm.friction(motion.t, motion.wanted_dq) for arm in learned])
        return outer_torque(arms, motion) + compensated

    def at(shares: Floats) -> list[Plant]:
        full = np.full((len(shares), len(members.axes)), 0.5)
        full[:, free] = shares
        return members.plants(full)

    few = motion.every(64)
    outside = convex_hull(lambda shares: outer_torque(at(shares), few).reshape(len(shares), -1), len(free))
    sides, parts = outside.of(rubbed(at(outside.points)))
    disturbance, effects, lacking = [], [], np.zeros((*motion.q.shape, motion.joints))
    for arm, known in zip(arms, beliefs, strict=True):
        mass, bias = known.mass_and_bias(motion.t, motion.q, motion.dq)
        masses, torques = rigid_body_torque([arm], motion)
        lacks = np.einsum("kij,kj->ki", mass, motion.ddq) + bias - torques[0]
        lacking = np.maximum(lacking, np.abs(np.eye(motion.joints) - np.linalg.solve(mass, masses[0])))
        disturbance.append(np.linalg.solve(mass[None], (lacks + sides)[..., None])[..., 0])
        effect = np.linalg.solve(mass[None], parts[..., None])[..., 0] if len(parts) else parts
        effects += [effect] * len(sides)
    kappa, coupling, matrices = inertia_ratios(arms, beliefs, motion)
    disturbances = np.concatenate(disturbance)
    largest = (np.abs(disturbances) + np.abs(np.array(effects)).sum(axis=1)).max(axis=0)
    learnt = (
        "the law has learned each joint's mean inertia along the motion and its Coulomb friction, within its learning "
        "limits"
    )
    between = f"the set between its ends in inertia: {len(arms)} members were evaluated"
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
        assumptions=[Assumption(learnt, "assumed"), Assumption(between, "tested")],
    )


def held_torque_error(belief: NominalModel, motion: StateSequence, disturbance: Floats) -> Floats:
    """`|M̂⁻¹ Δ(M̂ (q̈ - w*) + C0 q̇ + G0 + F̂)|` from each sample to the next [N n], because the torque is held.

    - `disturbance`: bounds of |w*| [N n], which the torque compensates.
    """
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    bias = bias + belief.friction(motion.t, motion.wanted_dq)
    change = np.einsum("kij,kj->ki", np.diff(mass, axis=0), motion.ddq[:-1]) + np.diff(bias, axis=0)
    bound = np.zeros_like(bias)
    bound[:-1] = np.abs(np.linalg.solve(mass[:-1], change[..., None])[..., 0])
    moved = np.abs(np.linalg.solve(mass[:-1], np.diff(mass, axis=0)))
    bound[:-1] += np.einsum("kij,kj->ki", moved, disturbance[:-1])
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
    """Return the demand of simulated arms with their learned models at each time.

    Every disturbance of the set acts on each of these arms.

    - `cases`: the arms and their models.
    - `belief`: the law's initial model.
    - `hull`, `plants`: the hull of the set, and the arms of its points, for deviations from the motion.
    """
    lacking = np.zeros((*motion.q.shape, motion.joints))
    at_first, bias = belief.at_first(motion.t, motion.q, motion.dq)
    free, outside, sides, parts = _disturbed(members, motion)
    disturbance, effects = [], []
    for arm, known in cases:
        mass = known.learnt(at_first, motion.t)
        masses, torques = rigid_body_torque([arm], motion)
        believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + known.friction(motion.t, motion.wanted_dq)
        lacks = believed - torques[0] - friction_torque(arm.robot, motion.dq) + sides
        disturbance.append(np.linalg.solve(mass[None], lacks[..., None])[..., 0])
        effects.append(np.linalg.solve(mass[None], parts[..., None])[..., 0] if len(parts) else parts)
        lacking = np.maximum(lacking, np.abs(np.eye(motion.joints) - np.linalg.solve(mass, masses[0])))
    arms, beliefs = [arm for arm, _ in cases], [known for _, known in cases]
    kappa, coupling, matrices = inertia_ratios(arms, beliefs, motion)
    disturbances = np.concatenate(disturbance)
    every = np.repeat(np.array(effects), len(sides), axis=0)
    largest: Floats = (np.abs(disturbances) + np.abs(every).sum(axis=1)).max(axis=0)
    tied = [k for k in range(len(members.axes)) if k not in free]
    listed = [
        Assumption(
            f"the law learns, so the bounds are for {len(cases)} simulated arms of the set, each with the rotor "
            f"inertias and friction learned at each time{', for ' + members.named(tied) if tied else ''}",
            "tested",
            float(len(cases)),
        )
    ]
    if free:
        listed.append(
            Assumption(
                f"{members.named(free)}: all values, on each of these arms, by "
                f"{len(sides)} computed disturbances and {len(parts)} linear parts",
                "tested",
                float(len(free)),
            )
        )
    if outside.sampled:
        listed.append(Assumption(f"{len(outside.sampled)} of these numbers at 5 values each", "tested"))
    return SetDemand(
        disturbance=disturbances,
        effects=every,
        kappa=kappa,
        coupling=coupling,
        deviation=deviation_bound(belief, motion, plants, hull, largest[None], beliefs),
        arms=len(arms),
        lacking=lacking,
        held=np.array([held_torque_error(model, motion, largest) for model in beliefs]).max(axis=0),
        beliefs=beliefs,
        relearning=np.array([_relearnt(model, motion, largest) for model in beliefs]).max(axis=0),
        matrices=matrices,
        assumptions=listed,
    )


def _disturbed(members: Members, motion: StateSequence) -> tuple[list[int], Hull, Floats, Floats]:
    """The axes of the disturbance, their hull, and its corners [C N n] and effects [E N n] of τ_d."""
    free = members.of_the_disturbance

    def at(shares: Floats) -> list[Plant]:
        full = np.full((len(shares), len(members.axes)), 0.5)
        full[:, free] = shares
        return members.plants(full)

    def probes(shares: Floats) -> Floats:
        arms = at(shares)
        few = motion.at(np.union1d(breakpoints(arms, motion.t[-1]), members.brief), instants=PROBES)
        return disturbance_torque(arms, few).reshape(len(shares), -1)

    outside = convex_hull(probes, len(free))
    sides, parts = outside.of(disturbance_torque(at(outside.points), motion))
    return free, outside, sides, parts


def _relearnt(belief: NominalModel, motion: StateSequence, disturbance: Floats) -> Floats:
    """`|M̂⁻¹ ΔM̂ ŵ|` from each sample to the next [N n], where ΔM̂ was learned in between."""
    rotor = belief.rotor_at(motion.t)
    step = np.abs(np.diff(rotor, axis=0, prepend=rotor[:1])) * disturbance
    mass, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    return np.einsum("kij,kj->ki", np.abs(np.linalg.inv(mass)), step)


def learned_ratios(scenario: Scenario) -> Floats:
    """Return K with learned models [I n n], at instants of the motion.

    The scenario's own arm has the model learned in a run; members at ends of the set have each joint's mean inertia.
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
    """Return the model of a law that has learned a member along a motion.

    - `belief`: its initial model.
    """
    law = scenario.controller
    assert isinstance(law, SampledData)
    assert isinstance(law.adaptation, JointLearning)
    assert belief.counted is not None
    learning, few = law.adaptation, motion.every(64)
    known = replace(belief, rotor=None).mass_and_bias(few.t, few.q, few.dq)[0]
    own = np.diagonal(known, axis1=1, axis2=2).mean(axis=0)
    true = np.diagonal(rigid_body_torque([plant], few)[0][0], axis1=1, axis2=2).mean(axis=0)
    links = own - belief.counted
    rotor = np.clip(
        belief.counted + true - own,
        np.asarray(learning.rotor_min) - 0.6 * links,
        np.asarray(learning.rotor_max) + links,
    )
    rubs = np.asarray(plant.robot.coulomb) if isinstance(plant.robot, Articulated | Coupled) else np.zeros_like(own)
    return replace(belief, rotor=rotor, coulomb=np.clip(rubs, 0.0, np.asarray(learning.coulomb_max)))
