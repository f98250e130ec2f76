"""Space of a scenario's uncertain numbers, as an image of the unit cube."""

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

    - `leaves`: the uncertain numbers by path.
    - `sets`: their sets by path.
    """

    leaves: Mapping[str, Leaf]
    sets: Mapping[str, AbstractSet]

    @cached_property
    def widths(self) -> dict[str, int]:
        """Number of coordinates of each path."""
        return {path: values.coordinates(self.leaves[path]) for path, values in self.sets.items()}

    @property
    def dimensions(self) -> int:
        """Dimensions of the unit cube."""
        return sum(self.widths.values())

    @property
    def coordinates(self) -> list[str]:
        """Names of the coordinates of the unit cube."""
        return [path if width == 1 else f"{path}[{k}]" for path, width in self.widths.items() for k in range(width)]

    def values(self, cube: Array) -> dict[str, Array]:
        """Return the values at points of the unit cube, by path, with the point as their first axis.

        - `cube`: [rows, dimensions], in [0, 1).

        Raises DefinitionError, with the path, if a set does not fit its number, or is empty.
        """
        if cube.shape[1:] != (self.dimensions,):
            raise DefinitionError(f"points of the cube have {self.dimensions} coordinates; got {list(cube.shape)}")
        values, first = {}, 0
        for path, choices in self.sets.items():
            width = self.widths[path]
            with located(path):
                values[path] = choices.values(cube[:, first : first + width], self.leaves[path])
            first += width
        return values

    def ends(self) -> list[dict[str, Any]]:
        """Return values at ends of the sets, to check them: all lowest, all highest, and alternating."""
        low, high = 0.0, np.nextafter(1.0, 0.0)
        turns = np.repeat(np.arange(len(self.widths)) % 2 == 0, list(self.widths.values()))
        points = np.array([np.full(len(turns), low), np.full(len(turns), high), *np.where([turns, ~turns], low, high)])
        drawn = self.values(points)
        return [{path: values[k] for path, values in drawn.items()} for k in range(len(points))]


def as_changes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return one case's arrays by path as plain values of a scenario file."""
    return {path: np.asarray(value).tolist() for path, value in values.items()}
