"""Inertial parameters of an arm's links in a scenario file."""

from __future__ import annotations

from typing import Annotated

import equinox as eqx
import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, as_array
from slidax.robots import Articulated
from slidax.robots.inertia import require_rigid

from .base import AbstractDescription, said

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]


def inertia_of(entries: list[float]) -> np.ndarray:
    """Return the inertia matrix [3 3], kg m², from xx, yy, zz, and optionally xy, xz, yz.

    Raises DefinitionError for another number of entries.
    """
    if len(entries) not in (3, 6):
        raise DefinitionError(f"must be 3 moments, or 6 entries; got {len(entries)}", where="inertia")
    xx, yy, zz, xy, xz, yz = [*entries, 0.0, 0.0, 0.0][:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class LinksDescription(AbstractDescription):
    """Inertial parameters of all links, one entry for each joint, in its frame."""

    mass: list[float] = said("masses", "kg")
    center: list[Three] = said("centres of mass", "m")
    inertia: list[Six] = said("inertias about the centres of mass, xx, yy, zz, xy, xz, yz", "kg m²")

    def applied(self, robot: Articulated) -> Articulated:
        """Return the arm with these links.

        Raises DefinitionError if their number differs from the arm's, or no rigid body has such parameters.
        """
        self.require_joints(robot.joints)
        if min(self.mass) < 0:
            raise DefinitionError(f"must be >= 0 kg; got {min(self.mass):g}", where="mass")
        inertias = [inertia_of(entries) for entries in self.inertia]
        for name, inertia in zip(robot.link_names, inertias, strict=True):
            require_rigid(inertia, f"the inertia of `{name}`", moves=False)
        return eqx.tree_at(
            lambda arm: (arm.masses, arm.centers, arm.inertias),
            robot,
            (as_array(self.mass), as_array(self.center), as_array(inertias)),
        )
