"""The certificates of a setting, as lights on a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from slidax.certificates import CERTIFICATES, Verdict, certify
from slidax.certificates.loop.loop_rate import NAME, TITLE
from slidax.scenarios import Scenario

SLOW = 3
"""Joints up to which the certificate of the loop's rate answers in seconds."""


def certificates_of(scenario: Scenario, paths: Sequence[str], rate: bool = False) -> list[dict[str, Any]]:
    """The verdicts on a scenario as it is: without what asks many runs, or, for arms of many joints, minutes.

    - `scenario`: it.
    - `paths`: of what a page can change; each light says on which of them it stands.
    - `rate`: whether that of the loop's rate is asked for arms of many joints, too.
    """
    left_out = [NAME] if scenario.plant.robot.joints > SLOW and not rate else []
    answers = {verdict.name: verdict for verdict in certify(scenario, runs=0, without=left_out)}
    found = []
    for certificate in CERTIFICATES:
        name = certificate.name
        verdict = answers.get(name) or _not_asked(scenario.plant.robot.joints)
        said = verdict.as_json()
        found.append(
            {
                "certificate": name,
                "title": verdict.title,
                "holds": verdict.holds,
                "since": said["since"],
                "grade": verdict.grade,
                "statement": verdict.statement,
                "margin": said["margin"],
                "bound": {key: value for key, value in said["bound"].items() if _brief(value)},
                "words": verdict.bound_in_words,
                "reads": [path for path in paths if certificate.may_read(path)],
            }
        )
    return found


def _not_asked(joints: int) -> Verdict:
    text = (
        f"It was not computed for this page: for {joints} joints that takes minutes. Download the scenario, and ask "
        "`slidax certify FILE`; or make the page by `slidax export web FILE --certify-rate --out DIR`."
    )
    return Verdict(NAME, TITLE, None, None, {}, (), text)


def _brief(value: Any) -> bool:
    return not isinstance(value, list) or (len(value) <= 16 and not any(isinstance(one, list) for one in value))
