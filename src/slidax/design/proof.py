"""Certificates of a design: torque demand on the drives, error bound, and estimation error of the disturbance.

The loop-rate rule of docs/loop-rate.md limits the estimation error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slidax.certify.arm.demand import Demand, compute_demand
from slidax.certify.arm.members import Members
from slidax.certify.arm.robust_torque import robust_torque
from slidax.certify.arm.torque_budget import motion_torques, torque_limits
from slidax.certify.certificate import Assumption, Verdict
from slidax.certify.motion.admission import tracking_bound
from slidax.core.errors import DefinitionError
from slidax.scenarios.scenario import Scenario, ScenarioDescription
from slidax.studies.cases import Cases, Values

from .candidates import DesignPoint, Floats
from .trials import Trials


@dataclass(frozen=True)
class DriveDemand:
    """Torques that the motion and the uncertainty set require of the drives and of the law's robust torque.

    - `demand`: the disturbances that the joints' estimators must follow, and the errors of the law's inertia.
    - `torque`, `limit`: largest torque along the motion, and torque limit of the drives [n], N m or N.
    - `u`: size of the law's robust torque [N m].
    - `needed`: largest model error that u must cover, as in the paper's eqs. (44), (45) [N m].
    """

    demand: Demand
    torque: Floats
    limit: Floats
    u: float
    needed: float


def drive_demand(scenario: Scenario) -> DriveDemand:
    """Return the torques that a scenario requires of its drives and of its robust torque, over its uncertainty set.

    Raises DefinitionError if the demand of the scenario cannot be bounded.
    """
    demand = compute_demand(scenario)
    members = Members.of(scenario, None)
    torque, _ = motion_torques(scenario, demand, members)
    limit, _ = torque_limits(scenario, members.plant.robot.joints)
    enough = robust_torque(scenario, demand).bound
    return DriveDemand(demand, torque, limit, float(enough["u"]), float(enough["needed"]))


def tracking_verdict(description: ScenarioDescription) -> Verdict:
    """Return the verdict of `tracking_bound` for a scenario; a failing one if it cannot be computed."""
    try:
        return tracking_bound(description.build("design"))
    except DefinitionError as error:
        lines = (Assumption(str(error), "fails"),)
        return Verdict(tracking_bound.name, tracking_bound.title, False, None, {}, lines, f"Not certified: {error}.")


RADII = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 32.0, 64.0)
"""Factors of the final radius to try with `tracking_bound`."""


def certified_radii(
    choice: DesignPoint, verdict_of: Callable[[DesignPoint], Verdict], largest: Floats
) -> tuple[DesignPoint, Verdict] | None:
    """Widen the envelope's final radii by the smallest factor in `RADII` with which a law is certified.

    Return the law with these radii, and its verdict; None if no factor suffices. The search bisects the factors, since
    a wider envelope is easier to certify.

    - `choice`: the law, with the smallest final radii to try.
    - `verdict_of`: returns the certificate's verdict on a law.
    - `largest`: largest final radii [n], rad or m.
    """

    def certified(index: int) -> tuple[DesignPoint, Verdict]:
        wider = replace(choice, final=np.minimum(RADII[index] * choice.final, largest))
        return wider, verdict_of(wider)

    least, most = 0, next((i for i, x in enumerate(RADII) if (x * choice.final >= largest).all()), len(RADII) - 1)
    smallest = certified(most)
    if not smallest[1].holds:
        return None
    while least < most:
        middle = (least + most) // 2
        law = certified(middle)
        if law[1].holds:
            smallest, most = law, middle
        else:
            least = middle + 1
    return smallest


FEW = 8
"""Number of cases for `error_in_cases`."""

MOST = 3
"""Largest number of joints that `EstimationError.in_words` names."""

NARROW = 1.05
"""An envelope counts as narrow if its width is at most this multiple of its width at the end."""


@dataclass(frozen=True)
class EstimationError:
    """Estimation error w̄ of each joint, and its limit by the loop-rate rule `(H + D h)² w̄ < ϑ ρ∞` (docs/loop-rate.md).

    w̄ is the largest error of the estimated disturbance acceleration. H is the planning horizon, h the period, D the
    delay in periods, and ϑ ρ∞ the final width of the envelope's narrower side.

    - `names`, `units`: names of the joints, and units of their positions.
    - `missed`, `allowed`: w̄, and its limit [n], rad/s² or m/s².
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    missed: Floats
    allowed: Floats

    @property
    def beyond(self) -> list[int]:
        """Indices of joints with a larger error than the rule allows, the worst first."""
        ratio = np.nan_to_num(self.missed / self.allowed, nan=np.inf)
        return [int(k) for k in np.argsort(-ratio) if ratio[k] >= 1.0]

    def in_words(self) -> str:
        """Return "`joint 6` has an estimation error of 41 rad/s² (limit: 28)", or the like; empty if the rule holds."""
        text = [
            f"`{self.names[k]}` has an estimation error of {self.missed[k]:.3g} {self.units[k]}/s² "
            f"(limit: {self.allowed[k]:.3g})"
            for k in self.beyond[:MOST]
        ]
        return ", ".join(text)

    def as_json(self) -> dict[str, Any]:
        """Return the estimation error and its limit by joint name."""
        each = zip(self.names, self.missed, self.allowed, strict=True)
        return {name: {"misses": float(missed), "rule": float(allowed)} for name, missed, allowed in each}


def error_in_cases(trials: Trials, choice: DesignPoint) -> EstimationError:
    """Return each joint's largest estimation error over 8 simulated cases, from when the envelope is narrow.

    - `trials`: simulates the law in the first common cases.
    - `choice`: the law.
    """
    law, cases = trials.space.values(choice), trials.cases(FEW)
    rows = len(next(iter(cases.values()))) if cases else 1
    values: Values = {
        **cases,
        **{path: np.repeat(np.asarray([item], float), rows, axis=0) for path, item in law.items()},
    }
    delay, h = trials.space.delay, trials.space.period
    worst = []
    for run in Cases(trials.family).logged(values):
        log = run.log
        assert log is not None
        assert log.envelope is not None
        width = np.asarray(log.envelope.upper) - np.asarray(log.envelope.lower)
        narrow = np.all(width <= NARROW * width[-1], axis=1)[1:]
        residual, disturbance = (np.asarray(log.signals[name]) for name in ("residual", "disturbance"))
        each = np.abs(residual[1:]) + delay * np.abs(np.diff(disturbance, axis=0))
        worst.append(np.max(each[narrow] if narrow.any() else each, axis=0))
    arm = trials.problem.robot.build().nominal
    allowed = choice.overshoot * np.asarray(choice.final) / (choice.horizon + delay * h) ** 2
    return EstimationError(arm.joint_names, arm.joint_units, np.max(worst, axis=0), allowed)
