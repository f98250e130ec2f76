"""Demand of an uncertainty set on the joints' loops: the disturbances to compensate, and the inertia ratios.

The members of the set are the true arms that it allows, each with its external forces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from slidax.plant.disturbances import Samples
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..certificate import Assumption
from ..sampled_scenario import Floats
from .arm_motion import (
    INSTANTS,
    NominalModel,
    StateSequence,
    distinct_inertias,
    inertia_ratios,
    outer_torque,
    rigid_body_torque,
)
from .hull import PROBES, Hull, convex_hull, probe_torques
from .learned_model import learns_inertia
from .members import MOST_ENDS, Members


@dataclass(frozen=True)
class Demand:
    """The disturbances that the joints' estimators must follow, and the error of the law's inertia.

    The error obeys `ë = K (a - q̈_r + w* - ŵ)`, where

    - `K = M⁻¹ M0`, with the true inertia M and the law's M0;
    - a is the commanded acceleration, q̈_r the reference's, and ŵ the estimate of the disturbance;
    - `w* = M0⁻¹ ((M0 - M) q̈_r + n0 - n + d)` is the disturbance that the law must compensate. n and n0 are the torques
      of the arm and of the model without their inertia term, and d is the external torque.

    Along the reference each member's disturbance is `Σ λ_m (w*_m + Σ x_k effects_mk)` with `λ >= 0`, `Σ λ = 1` and
    `|x_k| <= 1`. λ and x are constant over time, and the same for all joints.

    - `times`: samples, a period apart [times], s.
    - `disturbance`: w*_m along the reference for each extreme member m [members times n], rad/s² or m/s².
    - `kappa`: the least and the largest diagonal of K [2 n].
    - `coupling`: bounds of |K_ij/K_jj| for i ≠ j, the effect of other joints' accelerations [n n].
    - `assumptions`: assumptions of `disturbance` and its bounds; `of_kappa`: of `kappa` and `coupling`.
    - `effects`: change of each w* by half the range of an uncertain value [members values times n], rad/s² or m/s².
    - `jumps`: bound of the distance of w* from its chord between two samples [times n], rad/s² or m/s². Friction,
      external forces, and payloads that are attached or released contribute to it.
    - `matrices`: K of members at some instants of the motion [I n n].
    """

    times: Floats
    disturbance: Floats
    kappa: Floats
    coupling: Floats
    assumptions: Sequence[Assumption]
    effects: Floats | None = None
    of_kappa: Sequence[Assumption] = ()
    jumps: Floats | None = None
    matrices: Floats | None = None

    def worst(self, response: Callable[[Floats], Floats]) -> Floats:
        """Return the largest absolute value of a linear response to w*, over all members [times n].

        The member that attains it may be another one at each time and joint.

        - `response`: linear map from signals [... times n] to signals of that shape. For the identity, the result is
          the largest |w*|.
        """
        size = np.abs(response(self.disturbance))
        if self.effects is not None and self.effects.shape[1]:
            size = size + np.abs(response(self.effects)).sum(axis=1)
        return size.max(axis=0)


def compute_demand(scenario: Scenario, family: Family | None = None) -> Demand:
    """Return the demand of a scenario's uncertainty set along the motion.

    Without `uncertainty` the scenario's own arm is the only member. For a law that learns, M0 is its initial inertia.

    - `family`: a set in place of the scenario's own, such as a study's.

    Raises DefinitionError for a law without a model, or an invalid set.
    """
    members = Members.of(scenario, family)
    belief = NominalModel.of(scenario, members.plant)
    hull = convex_hull(lambda points: probe_torques(members, points), len(members.axes))
    plants = members.plants(hull.points)
    motion = StateSequence.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    nominal = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.dq)
    distinct, indices = distinct_inertias(plants)
    residual = nominal - rigid_body_torque(distinct, motion)[1][indices] + outer_torque(plants, motion)
    corners, linear = hull.of(np.linalg.solve(mass[None], residual[..., None])[..., 0])
    arms, _ = distinct_inertias(members.plants(members.ends(hull.without)))
    kappa, coupling, matrices = inertia_ratios(arms, [belief] * len(arms), motion)
    return Demand(
        times=motion.t,
        disturbance=corners,
        kappa=kappa,
        coupling=coupling,
        assumptions=_disturbance_assumptions(members, hull),
        of_kappa=[_kappa_assumption(members, hull, len(arms))],
        effects=np.broadcast_to(linear, (len(corners), *linear.shape)),
        jumps=_forces_between_samples(members, plants, (*corners, *linear), motion, belief),
        matrices=matrices,
    )


def _forces_between_samples(
    members: Members, plants: list[Plant], signals: Sequence[Floats], motion: StateSequence, belief: NominalModel
) -> Floats:
    """Bound the deviation of w* from its chord between two samples by forces and payloads [times n], rad/s² or m/s².

    The class of the friction, and of each term of the disturbance, declares a bound over the whole set. If a payload is
    attached or released in a period, the whole change of w* in that period is added.

    - `plants`: the arms of the hull's points. `signals`: w* of the corners, and its linear parts, each [times n].
    """
    samples = Samples(members.scenario.period, motion.t, motion.q, motion.dq)
    lower, upper = members.disturbances
    friction = members.largest_friction(plants)
    forces = lower.chord_deviation(upper, samples) + friction.chord_deviation(friction, samples)
    mass, _ = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    bound: Floats = np.einsum("kij,kj->ki", np.abs(np.linalg.inv(mass)), forces)
    jumps = np.zeros(len(motion.t), bool)
    for load in (plant.load for plant in plants if plant.load is not None):
        for time in (float(load.attached), float(load.released)):
            jumps |= samples.jumps(time, time)
    if jumps.any():
        steps = np.max([np.abs(np.diff(signal, axis=0, append=signal[-1:])) for signal in signals], axis=0)
        bound = bound + jumps[:, None] * steps
    return bound


def _disturbance_assumptions(members: Members, hull: Hull) -> list[Assumption]:
    learnt, count = learns_inertia(members.scenario), len(members.axes)
    assumptions = []
    if not count:
        text = "arm, external forces and payload are the scenario's own, since its `uncertainty` varies none of them"
        assumptions.append(Assumption(text, "assumed"))
    else:
        kept = [k for k in range(count) if k not in hull.sampled and k not in hull.without]
        text = (
            f"{members.named(kept)}: each member's disturbance at each sample is a convex combination of "
            f"{len(hull.corners)} computed members and {len(hull.effects)} linear parts, because these values enter "
            f"the torque as polynomials of degree 1 or 2{', as long as the law has learned nothing' if learnt else ''}"
        )
        if kept:
            assumptions.append(Assumption(text, "tested" if learnt else "proved"))
        if hull.without:
            text = (
                f"{members.named(hull.without)}: no torque depends on it, at {2 * PROBES} states and at the times when "
                "forces jump"
            )
            assumptions.append(Assumption(text, "tested"))
        if hull.sampled:
            text = (
                f"{members.named(hull.sampled)}: the torque is no polynomial of degree 1 or 2, or too many values "
                "multiply each other; so the set was sampled, at 5 values of each or at corners"
            )
            assumptions.append(Assumption(text, "tested"))
    text = (
        "between two samples each force deviates from its chord by at most the bound of its class, and the arm's own "
        "terms by at most an eighth of their second difference"
    )
    assumptions.append(Assumption(text, "tested"))
    if members.scenario.description.surroundings.table is not None:
        assumptions.append(Assumption("the arm does not touch the table, whose contact forces are left out", "assumed"))
    return assumptions


def _kappa_assumption(members: Members, hull: Hull, arms: int) -> Assumption:
    every = 2 ** len(members.inertial(hull.without)) + 1
    which = "corners of the set in inertia and its middle"
    if every > MOST_ENDS + 1:
        which += f" (of {every} in all)"
    text = (
        f"κ and the coupling are those of {arms} {'member' if arms == 1 else 'members'}, {which}, at {INSTANTS} "
        "instants of the motion, without deviations from it"
    )
    return Assumption(text, "tested", float(arms))
