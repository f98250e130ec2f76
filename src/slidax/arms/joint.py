"""Description of a joint with its link, and checks that a rigid body can have an inertia."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from slidax.core.errors import DefinitionError, Setting

ROUNDING = 1e-6
"""Allowed relative violation of the triangle inequality of moments, for inertias that are rounded in print."""

ZERO = 1e-9
"""A negative principal moment smaller than this part of the largest is a rounded 0."""

POINT = 1e-15
"""Moments below this are rounded zeros of a point mass [kg m²]. A grain of 1 mg and 0.1 mm has ten times as much."""


def require_rigid(inertia: np.ndarray, what: str, *, moves: bool, setting: Setting | None = None) -> None:
    """Raise DefinitionError unless a rigid body can have this inertia.

    A principal moment may be 0, as for a thin rod, or negative within rounding relative to the largest.

    - `inertia`: about the centre of mass, symmetric [3 3], kg m².
    - `what`: the inertia and its owner, for the message, such as "the inertia of link `forearm`".
    - `moves`: True if a joint moves the body; then an inertia of 0 is rejected, since it is usually a missing value.
    - `setting`: the setting that selects the nearest possible inertia, for the message.
    """
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.3g}" for moment in moments)
    end = f"; {setting.in_python} takes the nearest that a body can have" if setting else ""
    if moves and is_point(inertia):
        raise DefinitionError(
            f"{what} must be positive definite; its principal moments are {listed} kg m²; "
            "give the body its true inertia"
        )
    if is_rigid(inertia):
        return
    if moments[0] < -ZERO * abs(moments[2]):
        rule = "positive definite" if moves else "positive semi-definite"
        raise DefinitionError(f"{what} must be {rule}; its principal moments are {listed} kg m²{end}").offering(setting)
    raise DefinitionError(
        f"{what} is of no rigid body: the largest of its principal moments {listed} kg m² is more than the sum of the "
        f"others{end}"
    ).offering(setting)


def is_point(inertia: np.ndarray) -> bool:
    """True if an inertia [3 3] is 0 within rounding."""
    return bool(np.linalg.norm(inertia, 2) < POINT)


def is_rigid(inertia: np.ndarray) -> bool:
    """True if, within rounding, no principal moment is negative or greater than the sum of the others."""
    if is_point(inertia):
        return True
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] >= -ZERO * abs(moments[2]) and moments[0] + moments[1] >= moments[2] * (1.0 - ROUNDING))


def nearest_rigid(inertia: np.ndarray) -> np.ndarray:
    """Return the nearest inertia [3 3] that a rigid body can have, kg m².

    About its centre of mass a body of density ρ has the second moments `Σ = ∫ρ x xᵀ dV`, which are positive
    semi-definite, and the inertia `I = tr(Σ) 1 - Σ`, so `Σ = ½ tr(I) 1 - I`. Each positive semi-definite Σ belongs to
    some body. The nearest Σ in the Frobenius norm is the projection on these matrices: its negative eigenvalues become
    0 (Higham, *Computing a nearest symmetric positive semidefinite matrix*, 1988). The principal axes stay. With
    unchanged mass and centre of mass this is also the projection of the pseudo-inertia `[Σ 0; 0 m]` (Wensing, Kim and
    Slotine, *Linear matrix inequalities for physically consistent inertial parameter identification*, RA-L 2018).
    """
    moments, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    kept = np.maximum(moments, 0.0)
    return (axes * (kept.sum() - kept)) @ axes.T


def _zeros() -> np.ndarray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint and the link that it moves. The link's frame is also the joint's frame.

    - `kind`: "revolute", "prismatic" or "fixed"; a continuous joint is revolute with infinite limits.
    - `parent`: name of the parent joint; None for the base.
    - `link`: name of the link that the joint moves.
    - `rotation`, `translation`: the link's frame in the parent link's frame, at position 0 [3 3], [3], m.
    - `axis`: joint axis in the link's frame [3]; unused for a fixed joint.
    - `mass`: mass of the link, kg.
    - `center`: centre of mass, in the link's frame [3], m.
    - `inertia`: about the centre of mass, in the link's axes [3 3], kg m².
    - `lower`, `upper`: position limits, rad or m.
    - `velocity`, `torque`, `torque_rate`: limits, rad/s or m/s, N m or N, N m/s or N/s.
    - `armature`: rotor inertia at the joint, kg m² or kg.
    - `viscous`, `coulomb`: friction, N m s/rad or N s/m, N m or N.

    Raises DefinitionError, naming joint or link, for an invalid value. `assemble` rejects a link without mass unless
    another link with mass moves with it.
    """

    name: str
    kind: Literal["revolute", "prismatic", "fixed"]
    parent: str | None
    link: str
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    translation: np.ndarray = field(default_factory=_zeros)
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    mass: float = 0.0
    center: np.ndarray = field(default_factory=_zeros)
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    torque: float = math.inf
    torque_rate: float = math.inf
    armature: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in ("revolute", "prismatic", "fixed"):
            raise DefinitionError(
                f"joint `{self.name}` must be `revolute`, `prismatic` or `fixed`; got `{self.kind}`; a continuous "
                "joint is `revolute` with infinite limits"
            )
        rotation = np.asarray(self.rotation, float)
        square = rotation.shape == (3, 3) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        if not (square and np.linalg.det(rotation) > 0):
            raise DefinitionError(
                f"the frame of joint `{self.name}` must have orthonormal axes, right-handed; got {rotation.tolist()}"
            )
        _require_point(self.translation, f"the position of joint `{self.name}`")
        self._check_link()
        if self.kind != "fixed":
            self._check_motion()

    def _check_link(self) -> None:
        if not (math.isfinite(self.mass) and self.mass >= 0):
            raise DefinitionError(f"the mass of link `{self.link}` must be >= 0 kg and finite; got {self.mass:g}")
        _require_point(self.center, f"the centre of mass of link `{self.link}`")
        inertia = np.asarray(self.inertia, float)
        if inertia.shape != (3, 3) or not np.isfinite(inertia).all():
            raise DefinitionError(f"the inertia of link `{self.link}` must be 3 x 3 and finite; got {inertia.tolist()}")
        size = np.abs(inertia).max()
        if self.mass == 0:
            if size > 0:
                raise DefinitionError(f"link `{self.link}` has inertia but no mass; give it a mass > 0 kg")
            return
        if not np.allclose(inertia, inertia.T, rtol=0, atol=1e-9 * size):
            raise DefinitionError(f"the inertia of link `{self.link}` must be symmetric; got {inertia.tolist()}")
        # A point or a thin rod may be fixed to a link that is neither; `assemble` checks their sum.
        require_rigid(inertia, f"the inertia of link `{self.link}`", moves=self.kind != "fixed")

    def _check_motion(self) -> None:
        size = float(np.linalg.norm(self.axis))
        if np.shape(self.axis) != (3,) or not (math.isfinite(size) and size > 1e-9):
            raise DefinitionError(
                f"the axis of joint `{self.name}` must have a direction; got {np.asarray(self.axis).tolist()}"
            )
        if not self.lower < self.upper:
            raise DefinitionError(
                f"the limits of joint `{self.name}` must be lower < upper; got {self.lower:g} and {self.upper:g}"
            )
        for what in ("velocity", "torque", "torque_rate"):
            value = getattr(self, what)
            if not value > 0:
                name = what.replace("_", " ")
                raise DefinitionError(f"the {name} limit of joint `{self.name}` must be > 0; got {value:g}")
        for what in ("armature", "viscous", "coulomb"):
            value = getattr(self, what)
            if not (math.isfinite(value) and value >= 0):
                name = {"armature": "armature", "viscous": "viscous friction", "coulomb": "Coulomb friction"}[what]
                raise DefinitionError(f"the {name} of joint `{self.name}` must be >= 0 and finite; got {value:g}")


def _require_point(point: np.ndarray, what: str) -> None:
    if np.shape(point) != (3,) or not np.isfinite(point).all():
        raise DefinitionError(f"{what} must be three finite numbers; got {np.asarray(point).tolist()}")
