"""All that a scenario may be: its uncertain numbers together, as an image of the unit cube."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, located

from .leaf import Array, Leaf
from .sets import AbstractSet


@dataclass(frozen=True)
class Space:
    """Sets of values by path; each takes some coordinates of the unit cube, in the order of the paths.

    - `leaves`: the numbers that vary, by path.
    - `sets`: what each may be.
    """

    leaves: Mapping[str, Leaf]
    sets: Mapping[str, AbstractSet]

    @cached_property
    def widths(self) -> dict[str, int]:
        """How many coordinates each path takes."""
        return {path: one.coordinates(self.leaves[path]) for path, one in self.sets.items()}

    @property
    def dimensions(self) -> int:
        """Of the unit cube."""
        return sum(self.widths.values())

    @property
    def coordinates(self) -> list[str]:
        """What each coordinate of the unit cube is called."""
        return [path if width == 1 else f"{path}[{k}]" for path, width in self.widths.items() for k in range(width)]

    def values(self, cube: Array) -> dict[str, Array]:
        """The values at points of the unit cube, by path, with the point as their first axis.

        - `cube`: [rows, dimensions], in [0, 1).

        Raises DefinitionError, with the path, if a set does not fit its number, or is empty.
        """
        if cube.shape[1:] != (self.dimensions,):
            raise DefinitionError(f"points of the cube have {self.dimensions} coordinates; got {list(cube.shape)}")
        found, first = {}, 0
        for path, one in self.sets.items():
            width = self.widths[path]
            with located(path):
                found[path] = one.values(cube[:, first : first + width], self.leaves[path])
            first += width
        return found

    def ends(self) -> list[dict[str, Any]]:
        """Values at ends of the sets, for a check of them: all lowest, all highest, and by turns."""
        low, high = 0.0, np.nextafter(1.0, 0.0)
        turns = np.repeat(np.arange(len(self.widths)) % 2 == 0, list(self.widths.values()))
        points = np.array([np.full(len(turns), low), np.full(len(turns), high), *np.where([turns, ~turns], low, high)])
        drawn = self.values(points)
        return [{path: values[k] for path, values in drawn.items()} for k in range(len(points))]


def as_changes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as a scenario file has them.

    - `values`: arrays by path, of one case.
    """
    return {path: np.asarray(value).tolist() for path, value in values.items()}
