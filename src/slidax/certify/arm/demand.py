"""Demand of an uncertainty set on the joints' loops: the disturbances to compensate, and the inertia ratios."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from slidax.plant.disturbances import Samples
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario
from slidax.simulation.plant import Plant

from ..certificate import Assumption
from ..sampled_scenario import Floats, envelope_width, largest_error_rate
from .arm_motion import (
    INSTANTS,
    NominalModel,
    StateSequence,
    distinct_inertias,
    inertia_ratios,
    outer_torque,
    rigid_body_torque,
)
from .deviation_bound import PredictionErrorBound, deviation_bound
from .hull import PROBES, Hull, convex_hull, probe_torques
from .learned_demand import SetDemand, demand_after_learning, demand_of_cases, held_torque_error, learns_inertia
from .members import MOST_ENDS, Members


@dataclass(frozen=True)
class Demand:
    """The disturbances that the joints' estimators must follow, and the error of the law's inertia.

    With `K = M⁻¹ M0` the error obeys `ë = K (a - q̈_r + w* - ŵ)`. Here a is the commanded acceleration, ŵ the estimate,
    and `w* = M0⁻¹ ((M0 - M) q̈_r + n0 - n + d)` the disturbance that the law must compensate; n is the arm's torque
    except for its inertia term, d the external torque. Along the reference the disturbance of each member is, as a
    signal,
    `Σ λ_m (w*_m + Σ x_k effects_mk)` with `λ >= 0`, `Σ λ = 1` and `|x_k| <= 1`, the same for all times and joints.

    - `times`: samples, a period apart [N], s.
    - `disturbance`: w* along the reference for each extreme member [members N n], rad/s² or m/s².
    - `stray`: bound of the remaining part of w* at each time and joint, anywhere in the envelope [N n], rad/s² or m/s²;
      this part may change arbitrarily fast. inf if no bound is known. `deviation` gives a smaller one for smaller
      errors.
    - `kappa`: the least and the largest diagonal of K [2 n].
    - `coupling`: bounds of |K_ij/K_jj| for i ≠ j, the effect of other joints' accelerations [n n].
    - `assumptions`: of `disturbance`, `stray` and their bounds; `of_kappa`: of `kappa` and `coupling`.
    - `effects`: change of each w* by half the width of an uncertain value [members values N n], rad/s² or m/s².
    - `deviation`: from bounds of the error and its rate, each [n] or [N n], to the bound of `stray` [N n].
    - `prediction_error`: from bounds of the prediction errors of q and q̇ [N n] to the error of the torque [N n].
    - `jumps`: part of `stray` by the forces' deviation from their chord between two samples, and by payloads that are
      attached or released [N n].
    - `matrices`: K of some members at some instants of the motion, with the worst coupled one [I n n].
    - `relearning`: steps of ŵ when the law changes its learned inertia [N n]; None if it never does.
    """

    times: Floats
    disturbance: Floats
    stray: Floats
    kappa: Floats
    coupling: Floats
    assumptions: Sequence[Assumption]
    effects: Floats | None = None
    deviation: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    prediction_error: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    relearning: Floats | None = None
    of_kappa: Sequence[Assumption] = ()
    jumps: Floats | None = None
    matrices: Floats | None = None

    def boxed(self) -> Demand:
        """Return the demand with all effects in `stray`, by `|Σ x_k effects_k| <= Σ |effects_k|`.

        It is larger than necessary, because each x_k may then change over time.
        """
        if self.effects is None or not self.effects.shape[1]:
            return self
        stray = self.stray + np.abs(self.effects).sum(axis=1).max(axis=0)
        return replace(self, stray=stray, effects=None)

    def worst(self, response: Callable[[Floats], Floats]) -> Floats:
        """Return the largest |value| of a linear map of the disturbance over all members at each time and joint [N n].

        At each time a member attains it, but not the same one at all times.

        - `response`: maps signals [... N n] to such signals: the loops' response, or the identity.
        """
        size = np.abs(response(self.disturbance))
        if self.effects is not None and self.effects.shape[1]:
            size = size + np.abs(response(self.effects)).sum(axis=1)
        return size.max(axis=0)


def compute_demand(
    scenario: Scenario,
    family: Family | None = None,
    *,
    learnt: bool = False,
    along: StateSequence | None = None,
    cases: Sequence[tuple[Plant, NominalModel]] = (),
) -> Demand:
    """Return the disturbances that the joints' estimators must follow along the motion, and the error of M0.

    Without `uncertainty` the scenario's own arm is the only member.

    - `family`: another set, such as a study's.
    - `learnt`: if True, the model of a law that learns is the one learned for each member; else it is the initial one.
    - `along`: a motion in place of the reference, at the scenario's samples, with constant acceleration over each
      period. `stray` is then the part of w* between the samples, for a law with a held torque.
    - `cases`: for a law that learns, arms of the set with their learned models.

    Raises DefinitionError for a law without a model, or an invalid set.
    """
    members = Members.of(scenario, family)
    belief = NominalModel.of(scenario, members.plant)
    hull = convex_hull(lambda points: probe_torques(members, points), len(members.axes))
    plants = members.plants(hull.points)
    motion = StateSequence.of(scenario) if along is None else along
    if cases:
        request = demand_of_cases(members, cases, belief, hull, plants, motion)
    elif learnt and learns_inertia(scenario):
        request = demand_after_learning(members, belief, hull, plants, motion)
    else:
        request = _demand_before_learning(members, belief, hull, plants, motion)
    width = envelope_width(scenario, motion.t) if along is None else None
    jumps = forces_between_samples(members, plants, request, motion, scenario.period)
    if along is not None:
        stray: Floats = deviation_between_samples(request, along) + jumps
    else:
        stray = (
            request.deviation(width, largest_error_rate(scenario, width))
            if width is not None
            else np.zeros_like(motion.q)
        )
        stray = stray + jumps
    return Demand(
        times=motion.t,
        disturbance=request.disturbance,
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
        prediction_error=PredictionErrorBound.of(request.beliefs, motion, request.largest)
        if along is not None
        else None,
    )


def _demand_before_learning(
    members: Members, belief: NominalModel, hull: Hull, plants: list[Plant], motion: StateSequence
) -> SetDemand:
    """Return the demand for the law's initial model."""
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    nominal = np.einsum("kij,kj->ki", mass, motion.ddq) + bias + belief.friction(motion.t, motion.wanted_dq)
    distinct, indices = distinct_inertias(plants)
    masses, torques = rigid_body_torque(distinct, motion)
    residual = nominal - torques[indices] + outer_torque(plants, motion)
    disturbance = np.linalg.solve(mass[None], residual[..., None])[..., 0]
    corners, effects = hull.of(disturbance)
    arms, _ = distinct_inertias(members.plants(members.ends(hull.without)))
    kappa, coupling, matrices = inertia_ratios(arms, [belief] * len(arms), motion)
    return SetDemand(
        disturbance=corners,
        effects=np.broadcast_to(effects, (len(corners), *effects.shape)),
        kappa=kappa,
        coupling=coupling,
        deviation=deviation_bound(belief, motion, plants, hull, disturbance),
        arms=len(arms),
        lacking=hull.merged(indices).largest(np.eye(motion.joints) - np.linalg.solve(mass[None], masses)),
        held=held_torque_error(belief, motion, hull.largest(disturbance)),
        beliefs=[belief],
        relearning=None,
        matrices=matrices,
        assumptions=[],
    )


def deviation_between_samples(request: SetDemand, motion: StateSequence) -> Floats:
    """Bound the deviation of w* from its chord between two samples [N n], rad/s² or m/s².

    The bound is the sum of an eighth of the second difference, as for any smooth function; of the effect of the
    acceleration's jump at the end of a period, `|1 - M̂⁻¹M| |Δq̈|`; and of the change of M̂ and the bias while the torque
    is held.
    """
    deviation = np.zeros_like(motion.q)
    for signal in [*request.disturbance, *(effect for effects in request.effects for effect in effects)]:
        deviation[1:-1] = np.maximum(deviation[1:-1], np.abs(np.diff(signal, 2, axis=0)) / 8.0)
    deviation[:-1] = np.maximum(deviation[:-1], deviation[1:])
    jump = np.abs(np.diff(motion.ddq, axis=0, append=motion.ddq[-1:]))
    jump[1:] = np.maximum(jump[1:], jump[:-1])
    return deviation + np.einsum("kij,kj->ki", request.lacking, jump) + request.held


def forces_between_samples(
    members: Members, plants: list[Plant], request: SetDemand, motion: StateSequence, period: float
) -> Floats:
    """Bound the deviation of w* from its chord between two samples by forces and payloads [N n], rad/s² or m/s².

    For the arm's friction and each term of the disturbance it is the bound that its class declares over the whole set.
    For a period in which a payload is attached or released it is the total change of w*.

    - `plants`: the arms of the hull's points.
    - `period`: h, s.
    """
    samples = Samples(period, motion.t, motion.q, motion.dq)
    lower, upper = members.disturbances
    friction = members.largest_friction(plants)
    forces = lower.chord_deviation(upper, samples) + friction.chord_deviation(friction, samples)
    first, _ = request.beliefs[0].at_first(motion.t, motion.q, motion.dq)
    inverse = np.abs([np.linalg.inv(model.learnt(first, motion.t)) for model in request.beliefs])
    bound: Floats = np.einsum("bkij,kj->bki", inverse, forces).max(axis=0)
    jumps = np.zeros(len(motion.t), bool)
    for load in (plant.load for plant in plants if plant.load is not None):
        for time in (float(load.attached), float(load.released)):
            jumps |= samples.jumps(time, time)
    if jumps.any():
        signals = [*request.disturbance, *(effect for effects in request.effects for effect in effects)]
        steps = np.max([np.abs(np.diff(signal, axis=0, append=signal[-1:])) for signal in signals], axis=0)
        bound = bound + jumps[:, None] * steps
    return bound


def _disturbance_assumptions(members: Members, hull: Hull, simulated: bool) -> list[Assumption]:
    learnt, count = learns_inertia(members.scenario), len(members.axes)
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
