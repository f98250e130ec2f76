"""The certificate `inertia_ratio`: the loops bear the inertia of all arms of a set."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.adaptation import JointLearning
from slidax.controllers import SampledData
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario

from ..demand import Demand
from ..verdict import Assumption, Verdict
from .subject import lawful

Floats = NDArray[np.floating[Any]]

NAME, TITLE = "inertia_ratio", "each joint's loop bears the inertia of all arms of the set"

BETWEEN = 32
"""κ that are tried in a range, evenly in the logarithm."""


def inertia_ratio(scenario: Scenario, demand: Demand) -> Verdict:
    """Whether each joint's loop is stable for all κ of the set, coupled with the others by a small gain.

    - `scenario`: with a law in sampled-data form that plans, and a linear estimator.
    - `demand`: with the κ of the set against what the law believes at the start.
    """
    found = lawful(scenario)
    if isinstance(found, str):
        return Verdict(NAME, TITLE, None, None, {}, [], f"not applicable: {found}")
    law, _, loops = found
    description = scenario.description
    delay = description.sensor.delay + description.actuator.dead_time
    ranges = np.array([loop.stable_range(delay) for loop in loops]).T
    low, high = np.asarray(demand.kappa)
    radius = np.array(
        [
            max(loop.radius(float(kappa), delay) for kappa in np.geomspace(low[i], high[i], BETWEEN))
            for i, loop in enumerate(loops)
        ]
    )
    with np.errstate(invalid="ignore"):
        room = np.minimum(np.log(low / ranges[0]), np.log(ranges[1] / high))
    room = np.where(np.isfinite(room), room, -np.inf)
    joint = int(np.argmin(room))
    stable = bool(np.all(radius < 1.0) and np.all(room > 0.0))
    names = law.nominal.joint_names
    learning = _learning(law, stable)
    assumptions = [
        *demand.assumptions,
        Assumption(
            f"each loop's largest modulus is below 1 at {BETWEEN} κ of its range and up to the ends found by bisection",
            "checked" if stable else "fails",
            float(np.max(radius)),
        ),
        Assumption("near the goal, with s⁺ = 0 and a steep surface, the loop of a joint is linear", "assumed"),
        *learning,
    ]
    after = any("afterwards" in one.text and one.status != "fails" for one in learning)
    says = (
        f"κ of `{names[joint]}` is {low[joint]:.2g} to {high[joint]:.2g}, and its loop bears "
        f"{ranges[0, joint]:.2g} to {ranges[1, joint]:.2g} (docs/sampled-data.md, How wrong M0 may be)"
    )
    if not stable and after:
        says += "; what is learnt brings it there, which is not proved"
    margin = float(np.expm1(room[joint])) if np.isfinite(room[joint]) else None
    bound = {"kappa_from": low, "kappa_to": high, "stable_from": ranges[0], "stable_to": ranges[1], "radius": radius}
    remedies = [] if stable else _remedies(law)
    return Verdict(NAME, TITLE, stable, margin, bound, assumptions, says, remedies)


def _learning(law: SampledData, stable: bool) -> list[Assumption]:
    """What the law that learns asks for, before and afterwards."""
    learns = law.adaptation
    if not isinstance(learns, JointLearning):
        return []
    before = Assumption(
        "before anything is learnt the loop stands with the first guess, for the whole set",
        "checked" if stable else "assumed",
    )
    # Information grows by the square of the acceleration above the gate; the first guess is outweighed by as much.
    prior, gate = np.asarray(learns.prior), np.asarray(learns.gate)
    time = float(np.max(prior / gate**2))
    afterwards = Assumption(
        f"afterwards κ is nearer to 1: the joint must accelerate by more than {np.max(gate):.2g} rad/s² between "
        f"{float(learns.low):.3g} and {float(learns.high):.3g} rad/s, coherently with its torque, until ∫φ² dt "
        f"outweighs the first guess's {np.max(prior):.2g} (rad/s²)² s: {time:.2g} s of it at the gate, less with more",
        "assumed",
        time,
    )
    return [before, afterwards]


def _remedies(law: SampledData) -> list[Remedy]:
    found = []
    if law.adaptation is None:
        found.append(Remedy("let it be learnt", {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}}))
    assert law.horizon is not None
    horizon = float(law.horizon)
    found.append(
        Remedy("a longer horizon, for a model that is too heavy", {"scheme.sampled_data.horizon": 2 * horizon})
    )
    return found
