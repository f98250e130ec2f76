"""Scenarios at corners of an uncertainty set, for certificates that evaluate whole scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from slidax.scenarios import Scenario

from .arm.members import Members

CORNERS = 8
"""Number of corners."""


@lru_cache(maxsize=4)
def members_of(scenario: Scenario) -> Sequence[Scenario]:
    """Return the scenario, and scenarios at corners of its set at which its values act together.

    Raises DefinitionError if a set is empty or its path does not exist.
    """
    members = Members.of(scenario)
    family = members.family
    if not family.space.sets:
        return [scenario]
    shares = np.array([np.zeros(family.space.dimensions), np.full(family.space.dimensions, np.nextafter(1.0, 0.0))])
    values = {
        **family.space.values(np.resize(shares, (CORNERS, family.space.dimensions))),
        **members.values(members.extremes(CORNERS)),
    }
    cases = [{path: some[k] for path, some in values.items()} for k in range(CORNERS)]
    return [scenario, *(family.scenario(case, f"{scenario.name}, corner {k}") for k, case in enumerate(cases))]
