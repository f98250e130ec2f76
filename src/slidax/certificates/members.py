"""The uncertainty set of a scenario in canonical form."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty import Space

from .ends import ends_of


@lru_cache(maxsize=4)
def family_of(scenario: Scenario) -> Family | None:
    """Return the uncertainty set of a scenario in canonical form; None if it has none."""
    return canonical(Family.of(scenario.description)) if scenario.description.uncertainty else None


def canonical(family: Family) -> Family:
    """Return a set in the form that all certificates use, independent of the order in which it was written.

    Paths are sorted. A set of a single value is replaced by that value, so that nothing draws or bounds it.
    """
    space, truth, left = family.uncertain, dict(family.base.truth), {}
    for path in sorted(space.sets):
        lower, upper = ends_of(space.sets[path], space.leaves[path])
        own = space.leaves[path].own
        if not np.array_equal(lower, upper):
            left[path] = space.sets[path]
        elif own is None or not np.array_equal(np.broadcast_to(own, np.shape(lower)), lower):
            truth[path] = np.asarray(lower).tolist()
    base = family.base if truth == family.base.truth else family.base.model_copy(update={"truth": truth})
    return replace(family, base=base, uncertain=Space({path: space.leaves[path] for path in left}, left))
