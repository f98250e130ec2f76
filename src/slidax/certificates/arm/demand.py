"""What the set of a scenario asks of the loops of its joints along its motion."""

from __future__ import annotations

from itertools import product

import numpy as np

from slidax.scenarios import Scenario
from slidax.scenarios.family import Family

from ..demand import Demand
from ..verdict import Assumption
from .beside import beside_of
from .evaluated import Floats
from .hull import Hull, hull_of
from .members import Members
from .motion import Belief, Motion, kinds_of, needed, outer
from .width import speed_within, width_along

PROBES = 48
"""States drawn at random, by which is found how the numbers of a set enter."""

INSTANTS = 200
"""Of the motion, at which the range of κ is looked at."""

MOST_ARMS = 256
"""Members at ends of the set, whose κ is looked at."""


def demand(scenario: Scenario, family: Family | None = None) -> Demand:
    """What the estimators of the joints must follow along the scenario's motion, and how wrong M0 may be, in its set.

    - `scenario`: a law with a model of the arm, its motion, and the set in `uncertainty`; without one the scenario's own
      arm is the only member.
    - `family`: another set, such as a study's.

    Raises DefinitionError for a law without a model, or a set that is invalid.
    """
    members = Members.of(scenario, family)
    belief = Belief.of(scenario, members.plant)
    hull = hull_of(lambda points: _probed(members, points, scenario), len(members.axes))
    plants = members.plants(hull.points)
    motion = Motion.of(scenario)
    mass, bias = belief.mass_and_bias(motion.t, motion.q, motion.dq)
    believed = np.einsum("kij,kj->ki", mass, motion.ddq) + bias
    believed = believed + belief.coulomb * np.tanh(motion.dq / belief.smoothing)
    kinds, which = kinds_of(plants)
    lacks = believed - needed(kinds, motion)[1][which] + outer(plants, motion)
    push = np.linalg.solve(mass[None], lacks[..., None])[..., 0]
    corners, effects = hull.of(push)
    beside = beside_of(belief, motion, plants, hull, push)
    kappa, coupling, arms = _kappa(members, belief, hull, motion)
    width = width_along(scenario, motion.t)
    stray = beside(width, speed_within(scenario, width)) if width is not None else np.zeros_like(motion.q)
    return Demand(
        times=motion.t,
        push=corners,
        stray=stray,
        kappa=kappa,
        coupling=coupling,
        assumptions=_assumptions(members, hull, arms),
        effects=np.broadcast_to(effects, (len(corners), *effects.shape)),
        beside=beside,
    )


def _probed(members: Members, points: Floats, scenario: Scenario) -> Floats:
    """The torques of members at states drawn at random [P F]."""
    random = np.random.default_rng(0)
    n = members.plant.robot.joints
    q, dq, ddq = random.normal(size=(3, PROBES, n))
    states = Motion(np.linspace(0.0, scenario.t1, PROBES), q, dq, ddq)
    plants = members.plants(points)
    kinds, which = kinds_of(plants)
    torque = needed(kinds, states)[1][which] - outer(plants, states)
    return torque.reshape(len(points), -1)


def _kappa(members: Members, belief: Belief, hull: Hull, motion: Motion) -> tuple[Floats, Floats, int]:
    """The range of K's diagonal, the largest |K_ij/K_jj|, and at how many members."""
    every = max(1, len(motion.t) // INSTANTS)
    few = Motion(motion.t[::every], motion.q[::every], motion.dq[::every], motion.ddq[::every])
    plants = members.plants(_ends(members, hull))
    believed, _ = belief.mass_and_bias(few.t, few.q, few.dq)
    least = np.full(motion.joints, np.inf)
    most, coupling = -least, np.zeros((motion.joints, motion.joints))
    for plant in plants:
        ratio = np.linalg.solve(needed([plant], few)[0][0], believed)
        own = np.diagonal(ratio, axis1=1, axis2=2)
        least, most = np.minimum(least, own.min(axis=0)), np.maximum(most, own.max(axis=0))
        coupling = np.maximum(coupling, np.abs(ratio / own[:, None, :]).max(axis=0))
    np.fill_diagonal(coupling, 0.0)
    return np.array([least, most]), coupling, len(plants)


def _ends(members: Members, hull: Hull) -> Floats:
    """Corners of the box in what can change the inertia [P D], some of them drawn at random if they are many."""
    count = len(members.axes)
    acting = [k for k in range(count) if k not in hull.without and _is_inertial(members, k)]
    if 2 ** len(acting) <= MOST_ARMS:
        shares = np.array(list(product((0.0, 1.0), repeat=len(acting))))
    else:
        shares = np.random.default_rng(4).integers(0, 2, (MOST_ARMS, len(acting))).astype(float)
        shares[:2] = [[0.0] * len(acting), [1.0] * len(acting)]
    points = np.full((len(shares) + 1, count), 0.5)
    points[1:, acting] = shares.reshape(len(shares), len(acting))
    return points if acting else points[:1]


def _is_inertial(members: Members, axis: int) -> bool:
    path = members.axes[axis].path
    return path.startswith("robot.") and path.split(".")[-1] not in ("coulomb", "viscous", "gravity_acceleration")


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
    text = f"κ and the coupling: at {arms} members, ends of the set and its middle, at {INSTANTS} instants of the motion"
    found.append(Assumption(text, "checked"))
    if members.scenario.description.surroundings.table is not None:
        found.append(Assumption("the arm meets nothing: what a table pushes is not counted", "assumed"))
    return found

