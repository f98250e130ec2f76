"""What the set of a scenario asks of the loops of its joints along its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.disturbances import Samples
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.simulation import Plant

from ..demand import Demand
from ..verdict import Assumption
from .beside import beside_of
from .evaluated import Floats
from .hull import Hull, hull_of
from .learnt import Asked, after_learning, as_seen, held, learns
from .members import MOST_ENDS, Members
from .misread import Misread
from .motion import Belief, Motion, breakpoints, kinds_of, needed, outer
from .ratios import INSTANTS, ratios
from .width import speed_within, width_along

PROBES = 48
"""States drawn at random, and as many of the motion, by which is found how the numbers of a set enter."""


def demand(
    scenario: Scenario,
    family: Family | None = None,
    *,
    learnt: bool = False,
    along: Motion | None = None,
    seen: Sequence[tuple[Plant, Belief]] = (),
) -> Demand:
    """What the estimators of the joints must follow along the scenario's motion, and how wrong M0 may be, in its set.

    - `scenario`: a law with a model of the arm, its motion, and the set in `uncertainty`; without one the scenario's
      own arm is the only member.
    - `family`: another set, such as a study's.
    - `learnt`: for a law that learns its arm, whether it has: it then believes the inertia and the friction of each
      member. Else it believes what it starts with.
    - `along`: another motion than the reference, at the scenario's samples, of an arm whose acceleration is constant
      over each period. `stray` is then what w* does between the samples, of a law whose torque is held.
    - `seen`: for a law that learns, arms of the set with what it came to believe of each.

    Raises DefinitionError for a law without a model, or a set that is invalid.
    """
    members = Members.of(scenario, family)
    belief = Belief.of(scenario, members.plant)
    hull = hull_of(lambda points: probed(members, points), len(members.axes))
    plants = members.plants(hull.points)
    motion = Motion.of(scenario) if along is None else along
    if seen:
        found = as_seen(members, seen, belief, hull, plants, motion)
    elif learnt and learns(scenario):
        found = after_learning(members, belief, hull, plants, motion)
    else:
        found = _before(members, belief, hull, plants, motion)
    width = width_along(scenario, motion.t) if along is None else None
    jumping = pushed_between_samples(members, plants, found, motion, scenario.period)
    if along is not None:
        stray: Floats = between_samples(found, along) + jumping
    else:
        stray = found.beside(width, speed_within(scenario, width)) if width is not None else np.zeros_like(motion.q)
        stray = stray + jumping
    return Demand(
        times=motion.t,
        push=found.push,
        stray=stray,
        kappa=found.kappa,
        coupling=found.coupling,
        assumptions=[*found.assumptions, *_of_the_pushes(members, hull, bool(seen))],
        of_kappa=[_of_kappa(members, hull, found.arms, bool(seen))],
        effects=found.effects,
        jumping=jumping,
        matrices=found.matrices,
        beside=found.beside,
        relearnt=found.relearnt,
        misread=Misread.of(found.beliefs, motion, found.largest) if along is not None else None,
    )


def _before(members: Members, belief: Belief, hull: Hull, plants: list[Plant], motion: Motion) -> Asked:
    """What is asked for with what the law believes at first."""
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
        beside=beside_of(belief, motion, plants, hull, push),
        arms=len(arms),
        lacking=hull.merged(which).largest(np.eye(motion.joints) - np.linalg.solve(mass[None], masses)),
        held=held(belief, motion, hull.largest(push)),
        beliefs=[belief],
        relearnt=None,
        matrices=matrices,
        assumptions=[],
    )


def between_samples(asked: Asked, motion: Motion) -> Floats:
    """By how much w* may be off the line between its values at two samples [N n], rad/s² or m/s².

    An eighth of its second difference, as of any smooth function; what the acceleration's jump at the end of a period
    adds there, `|1 - M̂⁻¹M| |Δq̈|`; and what M̂ and the bias change while the torque is held.

    - `asked`: w* at the samples.
    - `motion`: along which.
    """
    bend = np.zeros_like(motion.q)
    for one in [*asked.push, *(part for each in asked.effects for part in each)]:
        bend[1:-1] = np.maximum(bend[1:-1], np.abs(np.diff(one, 2, axis=0)) / 8.0)
    bend[:-1] = np.maximum(bend[:-1], bend[1:])
    jump = np.abs(np.diff(motion.ddq, axis=0, append=motion.ddq[-1:]))
    jump[1:] = np.maximum(jump[1:], jump[:-1])
    return bend + np.einsum("kij,kj->ki", asked.lacking, jump) + asked.held


def pushed_between_samples(
    members: Members, plants: list[Plant], asked: Asked, motion: Motion, period: float
) -> Floats:
    """By how much forces may leave the line between their values at two samples, and a payload's jumps [N n].

    Of each term of the disturbance the bound that its class declares, over all of the set; of the arm's own friction
    likewise. In a period in which a payload is taken up or let go, all that w* changes by. rad/s² or m/s².

    - `members`: of the set.
    - `plants`: the arms of its hull's points.
    - `asked`: w* at the samples.
    - `motion`: along which.
    - `period`: h [s].
    """
    samples = Samples(period, motion.t, motion.q, motion.dq)
    lower, upper = members.disturbances
    forces = lower.off_chord(upper, samples) + members.rubbing(plants).off_chord(members.rubbing(plants), samples)
    first, _ = asked.beliefs[0].at_first(motion.t, motion.q, motion.dq)
    inverse = np.abs([np.linalg.inv(one.learnt(first, motion.t)) for one in asked.beliefs])
    found: Floats = np.einsum("bkij,kj->bki", inverse, forces).max(axis=0)
    jumps = np.zeros(len(motion.t), bool)
    for load in (plant.load for plant in plants if plant.load is not None):
        for time in (float(load.attached), float(load.released)):
            jumps |= samples.jumps(time, time)
    if jumps.any():
        parts = [*asked.push, *(part for each in asked.effects for part in each)]
        steps = np.max([np.abs(np.diff(one, axis=0, append=one[-1:])) for one in parts], axis=0)
        found = found + jumps[:, None] * steps
    return found


def probed(members: Members, points: Floats) -> Floats:
    """The torques of members at states drawn at random and at some of the motion [P F].

    At times drawn at random, at which no ripple vanishes but by chance, and at those at which a force of one of them
    sets in, jumps or ends, since a pulse may lie between all others, and at those of brief contacts.

    - `members`: of the set.
    - `points`: of its box [P D].
    """
    random = np.random.default_rng(0)
    motion, plants = Motion.of(members.scenario), members.plants(points)
    end = members.scenario.t1
    jumps = breakpoints(plants, end)
    pulses = jumps[:-1] + 0.5 * np.diff(jumps)
    t = np.concatenate([np.sort(random.uniform(0.0, end, PROBES)), jumps, pulses, members.brief])
    few = motion.at(t, instants=1)
    drawn = np.random.default_rng(1).normal(size=(3, PROBES, motion.joints))
    count = len(few.t)
    q, dq, ddq = (np.resize(one, (count, motion.joints)) for one in drawn)
    states = Motion(
        np.concatenate([few.t, few.t]),
        np.concatenate([q, few.q]),
        np.concatenate([dq, few.dq]),
        np.concatenate([ddq, few.ddq]),
    )
    kinds, which = kinds_of(plants)
    torque = needed(kinds, states)[1][which] - outer(plants, states)
    return torque.reshape(len(points), -1)


def _of_the_pushes(members: Members, hull: Hull, seen: bool) -> list[Assumption]:
    learnt, count = learns(members.scenario), len(members.axes)
    found = []
    if not count:
        text = "the arm, what pushes it and what it carries are the scenario's own: its `uncertainty` has none of them"
        found.append(Assumption(text, "assumed"))
    elif not seen:
        kept = [k for k in range(count) if k not in hull.sampled and k not in hull.without]
        text = (
            f"{members.named(kept)}: the push of each member at each sample is a convex mean of {len(hull.corners)} "
            f"computed ones and {len(hull.effects)} linear parts, since they enter the torque as polynomials of degree "
            f"1 or 2{', as long as the law has learnt nothing' if learnt else ''}"
        )
        if kept:
            found.append(Assumption(text, "tested" if learnt else "proved"))
        if hull.without:
            text = f"{members.named(hull.without)}: no torque depends on it, at {2 * PROBES} states and as forces jump"
            found.append(Assumption(text, "tested"))
        if hull.sampled:
            text = (
                f"{members.named(hull.sampled)}: no polynomial of few numbers; the set was sampled, at 5 values of "
                "each or at corners"
            )
            found.append(Assumption(text, "tested"))
    text = (
        "between two samples each force leaves the line between its values by no more than its class declares, the "
        "arm's own terms by an eighth of their second difference"
    )
    found.append(Assumption(text, "tested"))
    if members.scenario.description.surroundings.table is not None:
        found.append(Assumption("the arm meets nothing: what a table pushes is not counted", "assumed"))
    return found


def _of_kappa(members: Members, hull: Hull, arms: int, seen: bool) -> Assumption:
    every = 2 ** len(members.inertial(hull.without)) + 1
    which = "simulated ones" if seen else "ends of the set in inertia and its middle"
    if not seen and every > MOST_ENDS + 1:
        which += f", of {every}"
    text = (
        f"κ and the coupling: at {arms} {'member' if arms == 1 else 'members'}, {which}, at {INSTANTS} instants of the "
        "motion, and not beside it"
    )
    return Assumption(text, "tested", float(arms))
