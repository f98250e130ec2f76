"""Scenarios at corners of what is uncertain of one, for certificates that look at whole scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from slidax.scenarios import Scenario

from .arm.members import Members

CORNERS = 8
"""Cases of a set whose certificate looks at whole scenarios."""


@lru_cache(maxsize=4)
def members_of(scenario: Scenario) -> Sequence[Scenario]:
    """The scenario, and cases at corners of its set in which its numbers act together.

    - `scenario`: with its block `uncertainty`.

    Raises DefinitionError if a set is empty or leads nowhere.
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
    return [scenario, *(family.scenario(one, f"{scenario.name}, corner {k}") for k, one in enumerate(cases))]
