"""The parts of a scenario of which a certificate covers every value of an uncertain set."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from slidax.scenarios import Scenario
from slidax.scenarios.family import Family

from .members import canonical, family_of
from .verdict import Verdict

Asked = TypeVar("Asked", bound=Callable[..., Verdict])

ARM = ("robot", "disturbance", "start")
"""Blocks of which a set is bounded or tested by every certificate of an arm."""


def covers(name: str, title: str, *roots: str) -> Callable[[Asked], Asked]:
    """Declare of which uncertain parts a certificate speaks; with others it is not applicable.

    - `name`, `title`: of the certificate.
    - `roots`: paths with all that is below them, including those on which its claim does not depend.
    """

    def declared(certificate: Asked) -> Asked:
        @wraps(certificate)
        def asked(scenario: Scenario, *given: Any, **named: Any) -> Verdict:
            families = [one for one in (*given, *named.values()) if isinstance(one, Family)]
            text = uncovered(scenario, roots, families)
            return Verdict(name, title, None, None, {}, (), text) if text else certificate(scenario, *given, **named)

        asked.covers = roots  # type: ignore[attr-defined]
        asked.heading = (name, title)  # type: ignore[attr-defined]
        return asked  # type: ignore[return-value]

    return declared


def uncovered(scenario: Scenario, roots: tuple[str, ...], families: list[Family]) -> str:
    """The reason for which a certificate is not applicable: the paths that it does not cover; empty if there is none.

    - `scenario`: with its blocks `uncertainty` and `truth`.
    - `roots`: what it covers.
    - `families`: other sets than the scenario's own.
    """
    own = family_of(scenario)
    every = [canonical(one) for one in families] or ([] if own is None else [own])
    places = {
        "uncertainty": {path for one in every for path in one.space.sets},
        "truth": {path for one in every for path in one.base.truth} | set(scenario.description.truth),
    }
    for block, paths in places.items():
        others = sorted(path for path in paths if not any(f"{path}.".startswith(f"{root}.") for root in roots))
        if others:
            listed = ", ".join(f"`{path}`" for path in others)
            remedy = "`statistical` tests it; without it in the file this certificate applies"
            return f"not applicable: `{block}` has {listed}, which this certificate does not cover; {remedy}"
    return ""
