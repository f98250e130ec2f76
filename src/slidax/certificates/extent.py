"""The box of all starts of a scenario."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax.scenarios import Scenario

from .each import Floats
from .ends import ends_of
from .members import family_of

START = "start.q"


@dataclass(frozen=True)
class Extent:
    """Range of the start positions.

    - `lower`, `upper`: [n], rad or m.
    - `all_are`, `one_is`: subject and verb for a sentence about all starts, and about one of them.
    """

    lower: Floats
    upper: Floats
    all_are: str
    one_is: str


def starts_of(scenario: Scenario) -> Extent:
    """Return the scenario's start, or the box around all starts if it is uncertain.

    Raises DefinitionError if a set is empty.
    """
    own = np.asarray(scenario.state0.q, float)
    family = family_of(scenario)
    sets = {} if family is None else family.space.sets
    touching = [path for path in sets if path == START or path.startswith(f"{START}.")]
    if family is None or not touching:
        return Extent(own, own, "the start is", "the start is")
    lower, upper = own.copy(), own.copy()
    for path in touching:
        least, most = ends_of(sets[path], family.space.leaves[path])
        where = slice(None) if path == START else int(path.rpartition(".")[2])
        lower[where], upper[where] = least, most
    return Extent(lower, upper, "all starts of the uncertain set are", "a start of the uncertain set is")
