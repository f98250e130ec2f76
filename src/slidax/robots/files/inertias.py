"""Inertias in robot files that no rigid body can have: refused, or replaced by the nearest that one can."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from slidax._errors import DefinitionError, Setting, nearest

from ..inertia import is_rigid, nearest_rigid, require_rigid
from .mjcf_geometry import by_shape
from .notes import Notes

Inertias = Literal["given", "nearest"]

CHOICES = ("given", "nearest")
NEAREST = Setting("inertias", "nearest")


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

    def of(self, inertia: np.ndarray, owner: str, *, moves: bool) -> np.ndarray:
        """An inertia that a body can have: the given one, or the nearest.

        - `inertia`: about the centre of mass, symmetric [3 3], kg m².
        - `owner`: whose: "link `forearm`".
        - `moves`: whether a joint moves it by itself.

        Raises DefinitionError, naming the owner, if there is none.
        """
        if not np.isfinite(inertia).all() or is_rigid(inertia):
            return inertia
        close = nearest_rigid(inertia)
        what = f"the inertia of {owner}"
        helps = not moves or bool(np.any(close))
        if self._how == "given" or not helps:
            require_rigid(inertia, what, moves=moves, setting=NEAREST if helps else None)
        share = np.linalg.norm(close - inertia) / np.linalg.norm(inertia)
        self._replaced.append(f"{owner} (by {100 * share:.2g} %)")
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
                body.inertia = np.diagonal(self.of(np.diag(body.inertia), f"body `{body.name}`", moves=False))
            else:
                xx, yy, zz, xy, xz, yz = full
                given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                found = self.of(given, f"body `{body.name}`", moves=True)
                if found is not given:
                    body.fullinertia = found[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def add_to(self, notes: Notes) -> None:
        """Note which inertias were replaced, and by how much.

        - `notes`: of the reading.
        """
        if self._replaced:
            notes.add(f"inertias are changed to the nearest that a rigid body can have: of {', '.join(self._replaced)}")
