"""Inertias in robot files that no rigid body can have: refused, or replaced by the nearest that one can."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from slidax._errors import DefinitionError, nearest

from ..inertia import is_rigid, nearest_rigid, require_rigid
from .mjcf_geometry import by_shape

Inertias = Literal["given", "nearest"]

CHOICES = ("given", "nearest")
REMEDY = 'inertias="nearest" takes the nearest that a body can have'


class Feasible:
    """Looks at the inertias of a file, and remembers which it has replaced.

    - `how`: "given" to refuse those that no body can have, "nearest" to replace them.

    Raises DefinitionError for another word.
    """

    def __init__(self, how: str) -> None:
        if how not in CHOICES:
            raise DefinitionError(f"`inertias` must be `given` or `nearest`; got `{how}`; {nearest(str(how), CHOICES)}")
        self._how = how
        self._replaced: list[str] = []

    def of(self, inertia: np.ndarray, owner: str, *, definite: bool) -> np.ndarray:
        """An inertia that a body can have: the given one, or the nearest.

        - `inertia`: about the centre of mass, symmetric [3 3], kg m².
        - `owner`: whose: "link `forearm`".
        - `definite`: whether each moment must be > 0.

        Raises DefinitionError, naming the owner, if there is none.
        """
        if not np.isfinite(inertia).all() or is_rigid(inertia):
            return inertia
        close = nearest_rigid(inertia)
        what = f"the inertia of {owner}"
        helps = not definite or float(np.linalg.eigvalsh(close)[0]) > 1e-9 * float(np.abs(close).max())
        if self._how == "given" or not helps:
            require_rigid(inertia, what, definite=definite, remedy=REMEDY if helps else "")
        share = np.linalg.norm(close - inertia) / np.linalg.norm(inertia)
        self._replaced.append(f"{owner} ({100 * share:.2g} %)")
        return close

    def of_bodies(self, spec: Any) -> None:
        """The same for the bodies of an MJCF file, in their place.

        - `spec`: as MuJoCo has read it.

        Raises DefinitionError naming the body.
        """
        if spec.compiler.balanceinertia:
            return
        for body in spec.bodies:
            if body is spec.worldbody or not body.explicitinertial or by_shape(body):
                continue
            full = np.array(body.fullinertia)
            if np.isnan(full[0]):
                body.inertia = np.diagonal(self.of(np.diag(body.inertia), f"body `{body.name}`", definite=False))
            else:
                xx, yy, zz, xy, xz, yz = full
                given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                found = self.of(given, f"body `{body.name}`", definite=True)
                if found is not given:
                    body.fullinertia = found[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    @property
    def note(self) -> str:
        """What was replaced, and by how much; empty for nothing."""
        if not self._replaced:
            return ""
        return (
            "the nearest inertia that a body can have is taken, as the given one is of none, for "
            f"{', '.join(self._replaced)}"
        )
