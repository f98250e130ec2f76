"""Between which positions all starts of a scenario lie."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.scenarios import Scenario

from .ends import ends_of
from .members import family_of

Floats = NDArray[np.floating[Any]]

START = "start.q"


@dataclass(frozen=True)
class Extent:
    """The least and largest value of each joint.

    - `lower`, `upper`: [n], rad or m.
    - `said`, `one`: all of them and one of them, for a sentence.
    """

    lower: Floats
    upper: Floats
    said: str
    one: str


def starts_of(scenario: Scenario) -> Extent:
    """The scenario's start, or, where it is uncertain, the box around all of them.

    - `scenario`: with its block `uncertainty`.

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
