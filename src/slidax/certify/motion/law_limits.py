"""Conditions under which a certified law equals its linear loop.

The measurement gate accepts each sample, no limit on the law's estimates acts, the sliding variable s⁺ is 0, and the
error is inside the envelope.
"""

from __future__ import annotations

import numpy as np

from slidax.law.sampled.controller import STRONGEST

from ..certificate import Assumption
from .certified_law import CertifiedLaw
from .drive_limits import Torques
from .hand_over import HandOver
from .tracking_bound import CertifiedPath


def law_lines(law: CertifiedLaw, certified: CertifiedPath) -> list[Assumption]:
    """Return two assumptions: the gate accepts each sample, and no limit on the law's estimates acts.

    The value of each is the largest ratio of a bound to its limit. Below 1 the assumption is proved, else assumed.

    The gate (`MeasurementGate`) may reject a position for three reasons: it is out of range; it is too far from the
    last one; or it is the third in a row that repeats the one before, although the law predicts that the joint moves.
    In the third case the predicted travel is at most the innovation, the difference of measurement and prediction. So
    a bound of the innovation below the travel from which the gate rejects rules this case out.
    """
    gate, h, n = law.gate, law.loop.period, law.arm.joints
    q_max, speed, acceleration, spread = (
        np.broadcast_to(np.asarray(value, float), n)
        for value in (gate.q_max, gate.speed, gate.acceleration, gate.spread)
    )
    motion = certified.path.cells.pieces
    bounds, noise = certified.bounds, np.asarray(certified.inputs.resolution)
    fastest = motion.extremes(1).size + bounds.velocity.max(axis=0)
    position = motion.extremes(0).size + bounds.error.max(axis=0) + 0.5 * noise
    estimate = bounds.outputs["estimate"]
    lumped = np.einsum("nij,nj->ni", certified.solution.problem.at.inertia, estimate).max(axis=0)
    known = fastest + bounds.outputs["velocity_miss"].max(axis=0) + 0.5 * h * estimate.max(axis=0)
    gate_shares = (
        position / q_max,
        (h * fastest + noise) / (2.0 * h * speed + spread),
        bounds.outputs["innovation"].max(axis=0) / (2.0 * spread + acceleration * h**2),
    )
    # With a robust torque u, `plan_lines` checks the torque that compensates the estimate.
    unlimited = law.hand_over is not None and np.isfinite(law.hand_over.covered)
    law_shares = np.zeros(n) if unlimited else lumped / law.torque, known / speed, estimate.max(axis=0) / STRONGEST
    lines = []
    for text, shares in (
        ("the measurement gate rejects no sample of the arm itself", gate_shares),
        ("no limit of the law on its estimated disturbance or velocity acts", law_shares),
    ):
        largest = float(np.max(shares))
        lines.append(Assumption(text, "proved" if largest < 1.0 else "assumed", largest))
    return lines


def plan_lines(law: CertifiedLaw, certified: CertifiedPath) -> list[Assumption]:
    """Return the assumptions about a law with a sliding surface; none for another law.

    They are: the sliding variable stays at 0, the robust torque u exceeds the torque that compensates the estimated
    disturbance, and the error stays inside the envelope. The value of each is the largest ratio of a bound to its
    limit. Below 1 the assumption is proved, else it fails.
    """
    plan, along = law.hand_over, certified.solution.problem.hand_over
    if plan is None or along is None:
        return []
    lines = [_reached(plan, certified)]
    torques = Torques(certified.solution.problem, certified.bounds)
    if np.isfinite(plan.covered):
        estimate = np.minimum(
            np.einsum("nij,nj->ni", certified.solution.problem.at.inertia, certified.bounds.outputs["estimate"]),
            sum(torques.commanded("estimate").values()),
        )
        size = float(np.max(np.linalg.norm(estimate, axis=1)))
        text = f"the estimated disturbance is at most {size:.3g} N m, and the robust torque u is {plan.covered:.3g} N m"
        lines.append(Assumption(text, "proved" if size < plan.covered else "fails", size / max(plan.covered, 1e-300)))
    if np.all(np.isfinite(along.room)):
        outputs, h = certified.bounds.outputs, law.loop.period
        # The predicted error at the start of a torque's period, from the values in the middle of that period.
        predicted = outputs["model_position"] + 0.5 * h * outputs["model_velocity"]
        predicted = predicted + 0.375 * h * h * (outputs["command"] + outputs["estimate"])
        share = np.maximum(certified.bounds.error, predicted) / along.room
        cell, joint = (int(i) for i in np.unravel_index(int(np.argmax(share)), share.shape))
        text = (
            f"the error is inside the envelope at every time, at most {100 * share[cell, joint]:.0f} % of its width, "
            f"in `{law.arm.joint_names[joint]}` at {certified.path.cells.centres[cell]:.3g} s"
        )
        lines.append(Assumption(text, "proved" if share[cell, joint] < 1.0 else "fails", float(share[cell, joint])))
    return lines


def _reached(plan: HandOver, certified: CertifiedPath) -> Assumption:
    """Return the assumption that s⁺ is 0 at every sample.

    Then s is the output `sliding`, except at the first sample. There s is measured, while `sliding` is the first
    estimate of v. The difference decays by the factor `1 - h/H` in each period.
    """
    problem, bounds, inputs, loop = certified.solution.problem, certified.bounds, certified.inputs, certified.loop
    assert problem.hand_over is not None
    inertia, cells = problem.at.inertia, certified.path.cells
    led = inputs.start_error + 0.5 * inputs.resolution + (loop.lead + loop.delay * loop.period) * inputs.start_speed
    first = plan.first_sliding(led, inputs.start_speed, problem.hand_over) + inputs.start_speed
    fade = (1.0 - loop.period / plan.horizon) ** (cells.per_cell * np.arange(len(cells.q)))
    begun = fade[:, None] * first
    later = np.minimum(
        np.einsum("nij,nj->ni", inertia, bounds.outputs["sliding"]),
        sum(Torques(problem, bounds).commanded("sliding").values()),
    )
    torque = later + np.einsum("nij,nj->ni", inertia, begun)
    needed = plan.needed(torque / plan.horizon, bounds.outputs["sliding"] + begun)
    text = f"the sliding variable stays at 0: this needs {100 * needed:.0f} % of the reaching torque or integral gain"
    return Assumption(text, "proved" if needed < 1.0 else "fails", needed)
