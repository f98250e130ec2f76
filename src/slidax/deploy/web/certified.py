"""Certificates of a setting, shown as lights on a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slidax.certificates import CERTIFICATES, Verdict, certify
from slidax.certificates.loop.loop_rate import NAME, TITLE
from slidax.scenarios import Scenario

SLOW = 3
"""Joints up to which the loop-rate certificate takes seconds."""


def certificates_of(scenario: Scenario, paths: Sequence[str], rate: bool = False) -> list[dict[str, Any]]:
    """Verdicts on a scenario, without certificates that need many runs or, for arms of many joints, minutes.

    - `paths`: tunable paths; each light lists those that it depends on.
    - `rate`: compute the loop-rate certificate for arms of many joints, too.
    """
    left_out = [NAME] if scenario.plant.robot.joints > SLOW and not rate else []
    answers = {verdict.name: verdict for verdict in certify(scenario, runs=0, without=left_out)}
    lights = []
    for certificate in CERTIFICATES:
        name = certificate.name
        verdict = answers.get(name) or _not_asked(scenario.plant.robot.joints)
        data = verdict.as_json()
        lights.append(
            {
                "certificate": name,
                "title": verdict.title,
                "holds": verdict.holds,
                "since": data["since"],
                "grade": verdict.grade,
                "statement": verdict.statement,
                "margin": data["margin"],
                "bound": {key: value for key, value in data["bound"].items() if _brief(value)},
                "words": verdict.bound_in_words,
                "reads": [path for path in paths if certificate.may_read(path)],
            }
        )
    return lights


def _not_asked(joints: int) -> Verdict:
    text = (
        f"Not computed for this page: for {joints} joints it takes minutes. Download the scenario and run "
        "`slidax certify FILE`, or make the page by `slidax export web FILE --certify-rate --out DIR`."
    )
    return Verdict(NAME, TITLE, None, None, {}, (), text)


def _brief(value: Any) -> bool:
    return not isinstance(value, list) or (len(value) <= 16 and not any(isinstance(item, list) for item in value))
