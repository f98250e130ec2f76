"""The certificates of a setting, as lights on a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slidax.certificates import certify
from slidax.scenarios import Scenario

ARM = ("robot", "trajectory", "start", "disturbance", "actuator")

READS: dict[str, tuple[str, ...]] = {
    "admissibility": ("scheme", "trajectory", "start", "robot.nominal"),
    "uncertainty_bound": (*ARM, "scheme.bound"),
    "printed_period": (*ARM, "scheme", "simulation.period"),
}
"""What a certificate reads, by the roots of paths; any other may read all."""

ALL = (*ARM, "scheme", "sensor", "simulation")


SLOW = 3
"""Joints up to which the certificate of the loop's rate answers in seconds."""


def certificates_of(scenario: Scenario, paths: Sequence[str]) -> list[dict[str, Any]]:
    """What is certified of a scenario as it is: without what asks many runs, or, for arms of many joints, minutes.

    - `scenario`: it.
    - `paths`: of what a page can change; each light says on which of them it stands.
    """
    left_out = ["loop_rate"] if scenario.plant.robot.joints > SLOW else []
    found = []
    for verdict in certify(scenario, runs=0, without=left_out):
        roots = READS.get(verdict.name, ALL)
        said = verdict.as_json()
        found.append(
            {
                "certificate": verdict.name,
                "title": verdict.title,
                "holds": verdict.holds,
                "statement": verdict.statement,
                "margin": said["margin"],
                "bound": {name: value for name, value in said["bound"].items() if _brief(value)},
                "words": verdict.bound_in_words,
                "reads": [path for path in paths if any(f"{path}.".startswith(f"{root}.") for root in roots)],
            }
        )
    return found


def _brief(value: Any) -> bool:
    return not isinstance(value, list) or (len(value) <= 16 and not any(isinstance(one, list) for one in value))
