"""Certificates of a law, and their demands on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from slidax._errors import DefinitionError
from slidax.certificates.arm import compute_demand, robust_torque
from slidax.certificates.arm.members import Members
from slidax.certificates.arm.torque_budget import along_the_motion, limits_of
from slidax.certificates.demand import Demand
from slidax.certificates.loop import BEGINNINGS, loop_rate
from slidax.certificates.loop.jointly import JOINTS, Fineness
from slidax.certificates.verdict import Verdict
from slidax.scenarios import Scenario

from .choice import Choice, Floats

COARSE = Fineness(halvings=2, width=32)
"""Of many joints' bounds: a radius is found in less than half the time of `certify`, and is a tenth larger."""

WIDER = (1.02, 1.05, 1.1, 1.2)
"""The final radius over the one that `loop_rate` asks for, each time that it is widened to it.

The estimation error of a joint moves the others: with a constant factor, the radii of a UR3 stayed just
too small.
"""


@dataclass(frozen=True)
class Asked:
    """Demand of the motion and the uncertainty set on the drives and on u.

    - `demand`: of the loops.
    - `torque`: the largest along the motion [n]; `limit`: of the drives [n], N m or N.
    - `u`: what the law has [N m]; `needed`: what it lacks at most, (44), (45).
    """

    demand: Demand
    torque: Floats
    limit: Floats
    u: float
    needed: float


def asked_of(scenario: Scenario) -> Asked:
    """Return the demand of a scenario on its drives and on u, for all of its set.

    - `scenario`: with some law.

    Raises DefinitionError if there is no such bound for it.
    """
    demand = compute_demand(scenario)
    members = Members.of(scenario, None)
    torque, _ = along_the_motion(scenario, demand, members)
    limit, _ = limits_of(scenario, members.plant.robot.joints)
    enough = robust_torque(scenario, demand).bound
    return Asked(demand, torque, limit, float(enough["u"]), float(enough["needed"]))


def boundable(joints: int, learns: bool) -> bool:
    """True if `loop_rate` may have a bound: with four joints and more it never had one for a law that learns.

    - `joints`: of the arm.
    - `learns`: whether the law learns the inertia.
    """
    return joints < JOINTS or not learns


def of_the_rate(scenario: Scenario) -> Verdict | None:
    """The certificate `loop_rate` from when the envelope is narrow; None where it has no answer.

    From there the radius that it asks for is the smallest, and soonest found.

    - `scenario`: with its law.
    """
    try:
        return loop_rate(scenario, remedies=False, beginnings=BEGINNINGS[-1:], fineness=COARSE)
    except DefinitionError:
        return None


def radius_of(verdict: Verdict | None) -> Floats | None:
    """The smallest final radius of each joint with a bound [n]; None where there is none.

    - `verdict`: of `loop_rate`.
    """
    if verdict is None or "required_radius" not in verdict.bound:
        return None
    result = np.asarray(verdict.bound["required_radius"], float)
    return result if np.isfinite(result).all() and (result > 0).all() else None


def widened(
    choice: Choice, rate: Verdict | None, rate_of: Callable[[Choice], Verdict | None], largest: Floats
) -> tuple[Choice, Verdict] | None:
    """A law with final radii within which `loop_rate` holds, and its verdict; None where none was found.

    - `choice`: the law, which stays as it is if `loop_rate` holds.
    - `rate`: what `loop_rate` says of it.
    - `rate_of`: says the same of others.
    - `largest`: final radii [n].
    """
    for factor in WIDER:
        radius = radius_of(rate)
        if rate is None or rate.holds or radius is None:
            break
        choice = replace(choice, final=np.maximum(choice.final, factor * radius))
        if (choice.final > largest).any():
            return None
        rate = rate_of(choice)
    return (choice, rate) if rate is not None and rate.holds else None
