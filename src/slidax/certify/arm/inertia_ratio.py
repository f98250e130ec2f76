"""The certificate `inertia_ratio`: the joints' loops are stable for the inertia of all members of a set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.analysis.run_record import joint_loops
from slidax.core.errors import span
from slidax.law.calm_step import CalmStep
from slidax.law.implicit_steps import AbstractSurfaceStep
from slidax.law.joint_learning import JointLearning
from slidax.law.joint_loop import LinearLoop
from slidax.law.kalman import StrongTracking
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario

from ..certificate import ARM, Assumption, Verdict, certificate
from ..sampled_scenario import Floats
from .arm_motion import INSTANTS, NominalModel, StateSequence, inertia_ratios
from .demand import Demand
from .learned_model import learned_model, learns_inertia
from .members import Members

NAME, TITLE = "inertia_ratio", "the joints' loops are stable for the set's inertias"

MATRICES = 240
"""Largest number of matrices K for which the coupled loop is evaluated."""

BETWEEN = 32
"""Number of κ that are evaluated in a range, evenly spaced in the logarithm."""

MOST_ARMS = 16
"""Largest number of members at corners of the set in inertia, each with its own learned model."""


@certificate(NAME, TITLE, covers=ARM)
def inertia_ratio(scenario: Scenario, demand: Demand) -> Verdict:
    """Check that each joint's loop is stable for all κ of the set, and the coupled loops for the K of its members.

    `K = M⁻¹ M̂` with the true inertia M and the law's inertia M̂; κ is a diagonal entry of K.

    - `scenario`: scenario whose law is in sampled-data form, with a plan and a linear estimator.
    - `demand`: demand with the κ of the set for the law's initial model.
    """
    problem = linear_loops(scenario)
    if isinstance(problem, str):
        return Verdict(NAME, TITLE, None, None, {}, [], f"not applicable: {problem}")
    law, loops = problem
    delay = scenario.description.timing.total_delay
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
    alone = bool(np.all(radius < 1.0) and np.all(room > 0.0))
    together = _together(scenario, loops, demand, delay)
    stable = alone and together.radius < 1.0
    names = law.nominal.joint_names
    learning = _learning(law, alone)
    assumptions = [
        *demand.of_kappa,
        Assumption(
            f"each loop's eigenvalues have a modulus below 1 at {BETWEEN} κ of its range, which lies inside the stable "
            "range that bisection finds",
            "tested" if alone else "fails",
            float(np.max(radius)),
        ),
        *together.listed,
        Assumption("near e = 0, with s⁺ = 0 and a steep sliding surface, the loop of a joint is linear", "assumed"),
        *_irregular_samples(scenario),
        *learning,
    ]
    after = any("afterwards" in line.text and line.status != "fails" for line in learning)
    stable_for = "unstable even at κ = 1" if np.isnan(ranges[0, joint]) else f"stable for {span(*ranges[:, joint])}"
    says = (
        f"The inertia ratio κ of `{names[joint]}` is {span(low[joint], high[joint])}, and its loop is {stable_for} "
        "(docs/sampled-data.md, Admissible error of M0)"
    )
    if not alone and after:
        says += "; learning brings κ into this range, which is not proved"
    if alone and together.radius >= 1.0:
        says += f", for each joint alone; {together.says}"
    says += "."
    margin = float(np.expm1(room[joint])) if np.isfinite(room[joint]) else None
    bound = {"kappa_from": low, "kappa_to": high, "stable_from": ranges[0], "stable_to": ranges[1], "radius": radius}
    if np.isfinite(together.radius):
        bound["radius_together"] = together.radius
        margin = margin if margin is None or together.radius == 0.0 else min(margin, 1.0 / together.radius - 1.0)
    holds = None if alone and np.isinf(together.radius) else stable
    remedies = [] if alone else _remedies(law)
    return Verdict(NAME, TITLE, holds, margin, bound, assumptions, says, remedies)


def _irregular_samples(scenario: Scenario) -> list[Assumption]:
    """Return the assumption of regular samples if the scenario's sensor loses some or varies their delay."""
    sensor = scenario.description.sensor
    lossy = sensor.loss.probability or sensor.loss.outages or sensor.loss.trace
    names = [name for name, present in (("`sensor.loss`", lossy), ("`sensor.jitter`", sensor.jitter)) if present]
    if not names:
        return []
    text = f"every sample arrives, after the same delay; the loops are without {' and '.join(names)} of the scenario"
    return [Assumption(text, "assumed")]


def linear_loops(scenario: Scenario) -> tuple[SampledData, tuple[LinearLoop, ...]] | str:
    """Return the law and the linear loops of its joints, or the reason why the law has no linear loops."""
    law = scenario.controller
    if not isinstance(law, SampledData):
        return "the scheme is not in sampled-data form"
    if isinstance(law.step, CalmStep):
        return "the law takes calm steps, which are not covered: leave `scheme.sampled_data.calm` out"
    if isinstance(law.estimator, StrongTracking):
        return (
            "the estimator's bandwidth grows while its innovations are large, which is not covered: set "
            "`scheme.sampled_data.estimator.growth: 1`"
        )
    if not isinstance(law.step, AbstractSurfaceStep) or law.horizon is None:
        return "the law does not plan over a horizon"
    if law.midpoint or law.viscous_feedforward:
        return "the law evaluates its model at mid-period, or compensates viscous friction: see `tracking_bound`"
    if scenario.description.sensor.instrument is not None:
        return "the sensor is not an encoder"
    if np.any(np.asarray(scenario.description.actuator.time_constant) != 0.0):
        return (
            "the drives lag, which the loops here do not: set `actuator.time_constant: 0`, and add the lag to "
            "`sensor.delay`"
        )
    loops = joint_loops(scenario)
    linear = tuple(loop for loop in loops if loop is not None)
    if len(linear) < len(loops):
        return f"the estimator `{type(law.estimator).__name__}` is not linear"
    return law, linear


def coupled_radius(loops: Sequence[LinearLoop], matrix: Floats, delay: float) -> float:
    """Return the largest eigenvalue modulus of the coupled loops, `ë = K a` with the commanded accelerations a.

    - `loops`: the loop of each joint, all of one law: with the same period, horizon H and believed delay.
    - `matrix`: `K = M⁻¹ M̂` [n n], with the law's inertia M̂. `delay`: true delay, measurement to torque [periods].
    """
    n = len(loops)
    still, moved = ([loop.maps(kappa, delay).step for loop in loops] for kappa in (0.0, 1.0))
    own = len(still[0])
    step = np.zeros((n, own, n, own))
    for j in range(n):
        step[j, :, j] = still[j]
        step[:, :, j] += matrix[:, j, None, None] * (moved[j] - still[j])
    return float(np.max(np.abs(np.linalg.eigvals(step.reshape(n * own, n * own)))))


def learned_ratios(scenario: Scenario) -> Floats:
    """Return `K = M⁻¹ M̂` at I instants of the motion, with the true inertia M and M̂ that the law learns [I n n].

    The model for the scenario's own arm is learned in a simulated run. The models for members at corners of the set are
    those of `learned_model`.
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


@dataclass(frozen=True)
class _Together:
    """Stability of the coupled loop.

    - `radius`: largest eigenvalue modulus; 0 without coupling, inf if it was not computed.
    - `listed`: assumptions of the coupled loop.
    - `says`: the reason if the loop is not stable.
    """

    radius: float
    listed: list[Assumption]
    says: str


def _together(scenario: Scenario, loops: Sequence[LinearLoop], demand: Demand, delay: float) -> _Together:
    """Return the coupled loop's stability for K of members of the set, each constant over time."""
    if len(loops) == 1 or not np.any(demand.coupling):
        return _Together(0.0, [], "")
    if demand.matrices is None:
        says = "the stability of the coupled loop was not computed, since the given demand has no matrices K"
        return _Together(np.inf, [Assumption(says, "assumed")], says)
    # Half of the matrices are those farthest from I. The other half is evenly spaced in the order of that distance.
    learnt = learns_inertia(scenario)
    matrices_all = np.concatenate([demand.matrices, learned_ratios(scenario)]) if learnt else demand.matrices
    matrices = np.unique(np.round(matrices_all, 12), axis=0)
    far = np.argsort(-np.abs(matrices - np.eye(len(loops))).max(axis=(1, 2)), kind="stable")
    which = np.unique(np.concatenate([far[: MATRICES // 2], far[:: max(1, len(far) // (MATRICES // 2))]]))
    radius = max(coupled_radius(loops, matrices[k], delay) for k in which)
    text = f"the coupled loop's eigenvalues have a modulus below 1 for {len(which)} constant K of members on the motion"
    text += ", initial and learned" if learnt else ""
    says = f"together the joints' loops do not settle: their largest eigenvalue modulus is {radius:.4g} per period"
    return _Together(radius, [Assumption(text, "tested" if radius < 1.0 else "fails", radius)], says)


def _learning(law: SampledData, stable: bool) -> list[Assumption]:
    """Return the assumptions of a law that learns, before and after learning; none for another law."""
    learning = law.adaptation
    if not isinstance(learning, JointLearning):
        return []
    before = Assumption(
        "before learning the loop is stable with the initial model, for the whole set",
        "tested" if stable else "assumed",
    )
    # Information grows with the square of accelerations above the gate. Learning takes until it outweighs the prior.
    prior, gate = np.asarray(learning.prior), np.asarray(learning.gate)
    time = float(np.max(prior / gate**2))
    afterwards = Assumption(
        f"afterwards κ is nearer to 1: the joint must accelerate by more than {np.max(gate):.2g} rad/s² in the band "
        f"from {float(learning.low):.3g} to {float(learning.high):.3g} rad/s, coherently with its torque, until ∫q̈² dt "
        f"in it exceeds `prior`, {np.max(prior):.2g} (rad/s²)² s: {time:.2g} s at this acceleration, less above it",
        "assumed",
        time,
    )
    return [before, afterwards]


def _remedies(law: SampledData) -> list[Remedy]:
    remedies = []
    if law.adaptation is None:
        remedies.append(
            Remedy("learning of the inertia", {"scheme.sampled_data.adaptation": {"kind": "joint_learning"}})
        )
    assert law.horizon is not None
    horizon = float(law.horizon)
    remedies.append(
        Remedy("a longer horizon, for a model that is too heavy", {"scheme.sampled_data.horizon": 2 * horizon})
    )
    return remedies
