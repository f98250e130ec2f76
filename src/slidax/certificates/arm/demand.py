"""What the set of a scenario asks of the loops of its joints along its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.simulation import Plant

from ..demand import Demand
from ..verdict import Assumption
from .beside import beside_of
from .evaluated import Floats
from .hull import Hull, hull_of
from .learnt import Asked, after_learning, as_seen, held, learns
from .members import Members
from .misread import Misread
from .motion import Belief, Motion, kinds_of, needed, outer
from .ratios import INSTANTS, ratios
from .width import speed_within, width_along

PROBES = 48
"""States drawn at random, by which is found how the numbers of a set enter."""


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
    hull = hull_of(lambda points: probed(members, points, scenario), len(members.axes))
    plants = members.plants(hull.points)
    motion = Motion.of(scenario) if along is None else along
    if seen:
        found = as_seen(seen, belief, hull, plants, motion)
    elif learnt and learns(scenario):
        found = after_learning(members, belief, hull, plants, motion)
    else:
        found = _before(members, belief, hull, plants, motion)
    width = width_along(scenario, motion.t) if along is None else None
    if along is not None:
        stray = between_samples(found, along)
    else:
        stray = found.beside(width, speed_within(scenario, width)) if width is not None else np.zeros_like(motion.q)
    return Demand(
        times=motion.t,
        push=found.push,
        stray=stray,
        kappa=found.kappa,
        coupling=found.coupling,
        assumptions=[*_assumptions(members, hull, found.arms), *found.assumptions],
        effects=found.effects,
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
    kappa, coupling = ratios(arms, [belief] * len(arms), motion)
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
    found: Floats = bend + np.einsum("kij,kj->ki", asked.lacking, jump) + asked.held
    return found


def probed(members: Members, points: Floats, scenario: Scenario) -> Floats:
    """The torques of members at states drawn at random [P F]."""
    random = np.random.default_rng(0)
    n = members.plant.robot.joints
    q, dq, ddq = random.normal(size=(3, PROBES, n))
    states = Motion(np.linspace(0.0, scenario.t1, PROBES), q, dq, ddq)
    plants = members.plants(points)
    kinds, which = kinds_of(plants)
    torque = needed(kinds, states)[1][which] - outer(plants, states)
    return torque.reshape(len(points), -1)


def _assumptions(members: Members, hull: Hull, arms: int) -> list[Assumption]:
    names = [axis.name for axis in members.axes]
    found = []
    if not names:
        text = "the arm, what pushes it and what it carries are the scenario's own: its `uncertainty` has none of them"
        found.append(Assumption(text, "assumed"))
    else:
        kept = [name for k, name in enumerate(names) if k not in hull.sampled and k not in hull.without]
        text = (
            f"{', '.join(kept)}: the push of each member is a convex mean of {len(hull.corners)} computed ones and "
            f"{len(hull.effects)} linear parts, since they enter the torque as polynomials of degree 1 or 2"
        )
        found.append(Assumption(text, "proved"))
    if hull.sampled:
        text = f"{', '.join(names[k] for k in hull.sampled)}: no polynomial; the set was sampled at 5 values of each"
        found.append(Assumption(text, "checked"))
    if any(path.startswith("trajectory") for path in members.beside):
        found.append(Assumption("the motion is the scenario's own, though the set varies it", "fails"))
    text = (
        f"κ and the coupling: at {arms} members, ends of the set and its middle, at {INSTANTS} instants of the motion"
    )
    found.append(Assumption(text, "checked"))
    if members.scenario.description.surroundings.table is not None:
        found.append(Assumption("the arm meets nothing: what a table pushes is not counted", "assumed"))
    return found
