"""Certified error of a law against the speed of motions from rest to rest in a workspace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slidax.certify.motion.admission import MotionVerdict, certified_law, judge_motion, slowed
from slidax.motions.waypoints import MinimumJerk
from slidax.scenarios.robots import Arms
from slidax.scenarios.scenario import ScenarioDescription

from .candidates import Floats
from .problem import WorkspaceDescription

SPEEDS = (1.0, 0.7, 0.5, 0.35, 0.25)
"""Shares of the workspace's largest speed."""

MOTIONS = 6
"""Number of motions at each speed."""


@dataclass(frozen=True)
class SpeedRow:
    """Number of certified motions at one speed, and their bounds.

    - `speed`: share of the workspace's largest speed; accelerations are scaled by its square.
    - `motions`: number of motions at this speed.
    - `certified`: number of motions with an error bound within the final radius, and without an active torque limit.
    - `steps`: number of certified motions for which the torque-rate limit is not active either.
    - `median`, `largest`: median and largest error bound of the certified motions, for the worst joint [rad or m]; None
      if no motion is certified.
    - `reason`: the term that dominates most error bounds; if no motion is certified, the first limit that is exceeded.
    """

    speed: float
    motions: int
    certified: int
    steps: int
    median: float | None
    largest: float | None
    reason: str

    def as_json(self) -> dict[str, Any]:
        """Return the row as `slidax design --json` prints it."""
        return dict(vars(self))


def random_motions(
    workspace: WorkspaceDescription, arms: Arms, count: int = MOTIONS, seed: int = 0
) -> list[MinimumJerk]:
    """Return motions from rest to rest between random postures, as fast as the workspace's limits allow.

    One joint reaches its largest speed or acceleration.

    - `arms`: arms of the scenario; their position limits are the range if the workspace has none.
    - `seed`: seed of the random postures, which are uniformly distributed in the range of the positions.

    Raises DefinitionError if the range is empty, or neither the workspace nor the arm has one.
    """
    low, high = workspace.ends(arms)
    rng = np.random.default_rng(seed)
    return [
        MinimumJerk.within(
            rng.uniform(low, high, size=(2, len(low))), velocity=workspace.speed, acceleration=workspace.acceleration
        )
        for _ in range(count)
    ]


def speed_table(
    description: ScenarioDescription, motions: Sequence[MinimumJerk], allowed: Floats, speeds: Sequence[float] = SPEEDS
) -> Iterator[SpeedRow]:
    """Yield a row for each speed: the number of motions that `tracking_bound` certifies, as `slidax admit` does.

    - `description`: scenario with a law that `tracking_bound` covers.
    - `motions`: motions at full speed.
    - `allowed`: largest allowed error of each joint [n], rad or m.
    - `speeds`: shares of full speed.
    """
    law = certified_law(description.build("speeds"))
    for speed in speeds:
        yield _row(speed, [judge_motion(law, slowed(motion, 1.0 / speed), allowed) for motion in motions])


def _row(speed: float, answers: Sequence[MotionVerdict]) -> SpeedRow:
    certified = [answer for answer in answers if answer.verdict.holds]
    bounds = [float(np.max(answer.verdict.bound["error"])) for answer in certified]
    if certified:
        terms: list[dict[str, float]] = [answer.verdict.bound["terms"] for answer in certified]
        reason = Counter(max(each, key=lambda term: each[term]) for each in terms).most_common(1)[0][0]
    else:
        reason = next((str(limit) for answer in answers for limit in answer.limits if limit.what != "torque step"), "")
    return SpeedRow(
        speed=speed,
        motions=len(answers),
        certified=len(certified),
        steps=sum(answer.step_proved for answer in certified),
        median=float(np.median(bounds)) if bounds else None,
        largest=max(bounds) if bounds else None,
        reason=reason,
    )
