"""Reject inertias in robot files that no rigid body can have, or replace them by the nearest possible ones."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from slidax.core.errors import DefinitionError, Setting, nearest_word

from ..joint import is_point, is_rigid, nearest_rigid, require_rigid
from .mjcf_checks import has_inertia_from_shapes
from .reading import Notes

Inertias = Literal["given", "nearest", "strict"]

CHOICES = ("given", "nearest", "strict")
NEAREST = Setting("inertias", "nearest")

REPLACED = "inertias that no rigid body can have"
"""Start of the note on replaced inertias."""


PRINTED = 0.01
"""Largest change by "given", relative to the largest principal moment: the effect of rounding to three digits.

Such rounding changes each entry by at most 0.5 %: a body's inertia I becomes I + E with `|E_ij| ≤ 0.005 |I_ij|`. The
worst case is a flat body, with the principal moments `I₁ + I₂ = I₃`, so that `‖I‖ ≤ √2 I₃` in the Frobenius norm. With
a unit eigenvector u, an eigenvalue of `½ tr(E) 1 - E` is `⟨E, ½ 1 - u uᵀ⟩ ≤ 0.005 (√3/2) √2 I₃`, one of E is at most
`0.005 √2 I₃`. So the projection changes no principal moment by more than 0.71 % of the largest.
"""


class RigidInertias:
    """Checks the inertias of a file and records the replaced ones.

    - `how`: "strict" rejects each inertia that no body can have, "nearest" replaces it by the nearest possible one, and
      "given" replaces it if no principal moment is negative and none changes by more than 1 % of the largest.

    Raises DefinitionError for another value.
    """

    def __init__(self, how: str) -> None:
        if how not in CHOICES:
            listed = ", ".join(f"`{choice}`" for choice in CHOICES[:-1])
            raise DefinitionError(
                f"`inertias` must be {listed} or `{CHOICES[-1]}`; got `{how}`; {nearest_word(str(how), CHOICES)}"
            )
        self._how = how
        self._changes: dict[str, float] = {}

    def of(self, inertia: np.ndarray, owner: str, *, moves: bool) -> np.ndarray:
        """Return the inertia itself if a body can have it, else the nearest possible one.

        - `inertia`: about the centre of mass, symmetric [3 3], kg m².
        - `owner`: the link or body with this inertia, such as "link `forearm`".
        - `moves`: True if a joint moves it directly.

        Raises DefinitionError, naming the owner, if the inertia must not be replaced.
        """
        if not np.isfinite(inertia).all() or is_rigid(inertia):
            return inertia
        close = nearest_rigid(inertia)
        # The principal axes are equal, so the spectral norm of the difference is the largest change of a moment.
        change = float(np.linalg.norm(close - inertia, 2) / np.linalg.norm(inertia, 2))
        helps = not moves or not is_point(close)
        # A negative moment may become 0, and a joint about that axis would have no inertia.
        rounded = change <= PRINTED and np.linalg.eigvalsh(inertia)[0] >= 0.0
        if not helps or self._how == "strict" or (self._how == "given" and not rounded):
            require_rigid(inertia, f"the inertia of {owner}", moves=moves, setting=NEAREST if helps else None)
        self._changes[owner] = change
        return close

    def of_bodies(self, spec: Any) -> None:
        """Check the inertias of all bodies of a MuJoCo `MjSpec`, as `of` does, and replace them in place.

        Raises DefinitionError naming the body.
        """
        if spec.compiler.balanceinertia:
            return
        for body in spec.bodies:
            if body is spec.worldbody or not body.explicitinertial or has_inertia_from_shapes(body):
                continue
            full = np.array(body.fullinertia)
            if np.isnan(full[0]):
                body.inertia = np.diagonal(self.of(np.diag(body.inertia), f"body `{body.name}`", moves=False))
            else:
                xx, yy, zz, xy, xz, yz = full
                inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                rigid = self.of(inertia, f"body `{body.name}`", moves=True)
                if rigid is not inertia:
                    body.fullinertia = rigid[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    def add_to(self, notes: Notes) -> None:
        """Add to the notes the owners of the replaced inertias with their changes, the largest first."""
        strict = '; inertias="strict" refuses them' if self._how == "given" else ""
        for owner in sorted(self._changes, key=lambda name: -self._changes[name]):
            notes.add(
                f"{REPLACED} are changed to the nearest possible; they differ by a share of the largest principal "
                f"moment: {{}}{strict}",
                f"{owner} ({100 * self._changes[owner]:.2g} %)",
            )
