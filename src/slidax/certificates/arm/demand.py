"""The demand of a scenario's set on its joints' loops along its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.disturbances import Samples
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.simulation import Plant

from ..demand import Demand
from ..each import Floats
from ..verdict import Assumption
from .beside import beside_of
from .hull import Hull, hull_of
from .learnt import Asked, after_learning, as_seen, held_torque_error, learns
from .members import MOST_ENDS, Members
from .misread import Misread
from .motion import Belief, Motion, kinds_of, needed, outer
from .part import PROBES, probed
from .ratios import INSTANTS, ratios
from .width import speed_within, width_along


def compute_demand(
    scenario: Scenario,
    family: Family | None = None,
    *,
    learnt: bool = False,
    along: Motion | None = None,
    cases: Sequence[tuple[Plant, Belief]] = (),
) -> Demand:
    """Return the disturbances that the joints' estimators must follow along the motion, and the error of M0.

    Without `uncertainty` the scenario's own arm is the only member.

    - `family`: another set, such as a study's.
    - `learnt`: if True, a law that learns has learned each member's inertia and friction; else it has its initial
      model.
    - `along`: another motion than the reference, at the scenario's samples, with constant acceleration over each
      period. `stray` is then the part of w* between the samples, for a law with a held torque.
    - `cases`: for a law that learns, arms of the set with their learned models.

    Raises DefinitionError for a law without a model, or an invalid set.
    """
    members = Members.of(scenario, family)
    belief = Belief.of(scenario, members.plant)
    hull = hull_of(lambda points: probed(members, points), len(members.axes))
    plants = members.plants(hull.points)
    motion = Motion.of(scenario) if along is None else along
    if cases:
        request = as_seen(members, cases, belief, hull, plants, motion)
    elif learnt and learns(scenario):
        request = after_learning(members, belief, hull, plants, motion)
    else:
        request = _before(members, belief, hull, plants, motion)
    width = width_along(scenario, motion.t) if along is None else None
    jumps = pushed_between_samples(members, plants, request, motion, scenario.period)
    if along is not None:
        stray: Floats = between_samples(request, along) + jumps
    else:
        stray = (
            request.deviation(width, speed_within(scenario, width)) if width is not None else np.zeros_like(motion.q)
        )
        stray = stray + jumps
    return Demand(
        times=motion.t,
        push=request.push,
        stray=stray,
        kappa=request.kappa,
        coupling=request.coupling,
        assumptions=[*request.assumptions, *_disturbance_assumptions(members, hull, bool(cases))],
        of_kappa=[_kappa_assumption(members, hull, request.arms, bool(cases))],
        effects=request.effects,
        jumps=jumps,
        matrices=request.matrices,
        deviation=request.deviation,
        relearning=request.relearning,
        prediction_error=Misread.of(request.beliefs, motion, request.largest) if along is not None else None,
    )


def _before(members: Members, belief: Belief, hull: Hull, plants: list[Plant], motion: Motion) -> Asked:
    """The demand on the law's initial model."""
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    kinds, which = kinds_of(plants)
    masses, torques = needed(kinds, motion)
    lacks = believed - torques[which] + outer(plants, motion)
    push = np.linalg.solve(mass[None], lacks[..., None])[..., 0]
    corners, effects = hull.of(push)
    arms, _ = kinds_of(members.plants(members.ends(hull.without)))
    kappa, coupling, matrices = ratios(arms, [belief] * len(arms), motion)
    return Asked(
        push=corners,
        effects=np.broadcast_to(effects, (len(corners), *effects.shape)),
        kappa=kappa,
        coupling=coupling,
        deviation=beside_of(belief, motion, plants, hull, push),
        arms=len(arms),
        lacking=hull.merged(which).largest(np.eye(motion.joints) - np.linalg.solve(mass[None], masses)),
        held=held_torque_error(belief, motion, hull.largest(push)),
        beliefs=[belief],
        relearning=None,
        matrices=matrices,
        assumptions=[],
    )


def between_samples(request: Asked, motion: Motion) -> Floats:
    """Bound how far w* lies off the line between its values at two samples [N n], rad/s² or m/s².

    The sum of an eighth of its second difference, as for any smooth function; of the effect of the acceleration's jump
    at the end of a period, `|1 - M̂⁻¹M| |Δq̈|`; and of the change of M̂ and the bias while the torque is held.
    """
    bend = np.zeros_like(motion.q)
    for signal in [*request.push, *(part for each in request.effects for part in each)]:
        bend[1:-1] = np.maximum(bend[1:-1], np.abs(np.diff(signal, 2, axis=0)) / 8.0)
    bend[:-1] = np.maximum(bend[:-1], bend[1:])
    jump = np.abs(np.diff(motion.ddq, axis=0, append=motion.ddq[-1:]))
    jump[1:] = np.maximum(jump[1:], jump[:-1])
    return bend + np.einsum("kij,kj->ki", request.lacking, jump) + request.held


def pushed_between_samples(
    members: Members, plants: list[Plant], request: Asked, motion: Motion, period: float
) -> Floats:
    """Bound how far forces leave the line between two samples, and how far payloads make w* jump [N n], rad/s² or m/s².

    For each term of the disturbance, and for the arm's friction, the bound that its class declares over all of the set.
    For a period in which a payload is attached or released, the whole change of w*.

    - `plants`: the arms of the hull's points.
    - `period`: h, s.
    """
    samples = Samples(period, motion.t, motion.q, motion.dq)
    lower, upper = members.disturbances
    forces = lower.off_chord(upper, samples) + members.rubbing(plants).off_chord(members.rubbing(plants), samples)
    first, _ = request.beliefs[0].at_first(motion.t, motion.q, motion.dq)
    inverse = np.abs([np.linalg.inv(model.learnt(first, motion.t)) for model in request.beliefs])
    bound: Floats = np.einsum("bkij,kj->bki", inverse, forces).max(axis=0)
    jumps = np.zeros(len(motion.t), bool)
    for load in (plant.load for plant in plants if plant.load is not None):
        for time in (float(load.attached), float(load.released)):
            jumps |= samples.jumps(time, time)
    if jumps.any():
        parts = [*request.push, *(part for each in request.effects for part in each)]
        steps = np.max([np.abs(np.diff(part, axis=0, append=part[-1:])) for part in parts], axis=0)
        bound = bound + jumps[:, None] * steps
    return bound


def _disturbance_assumptions(members: Members, hull: Hull, simulated: bool) -> list[Assumption]:
    learnt, count = learns(members.scenario), len(members.axes)
    assumptions = []
    if not count:
        text = "arm, external forces and payload are the scenario's own: its `uncertainty` has no values of them"
        assumptions.append(Assumption(text, "assumed"))
    elif not simulated:
        kept = [k for k in range(count) if k not in hull.sampled and k not in hull.without]
        text = (
            f"{members.named(kept)}: each member's disturbance at each sample is a convex combination of "
            f"{len(hull.corners)} computed ones and {len(hull.effects)} linear parts, because these values enter the "
            f"torque as polynomials of degree 1 or 2{', as long as the law has learned nothing' if learnt else ''}"
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
                f"{members.named(hull.sampled)}: no polynomial of few values; the set was sampled, at 5 values of "
                "each or at corners"
            )
            assumptions.append(Assumption(text, "tested"))
    text = (
        "between two samples each force leaves the line between its values by no more than its class declares, the "
        "arm's own terms by an eighth of their second difference"
    )
    assumptions.append(Assumption(text, "tested"))
    if members.scenario.description.surroundings.table is not None:
        assumptions.append(Assumption("the arm touches nothing: contact forces of a table are not counted", "assumed"))
    return assumptions


def _kappa_assumption(members: Members, hull: Hull, arms: int, simulated: bool) -> Assumption:
    every = 2 ** len(members.inertial(hull.without)) + 1
    which = "simulated ones" if simulated else "ends of the set in inertia and its middle"
    if not simulated and every > MOST_ENDS + 1:
        which += f", of {every}"
    text = (
        f"κ and the coupling: at {arms} {'member' if arms == 1 else 'members'}, {which}, at {INSTANTS} instants of the "
        "motion, without deviations from it"
    )
    return Assumption(text, "tested", float(arms))
