"""A joint as a file or a data sheet describes it, with the link that it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from slidax._errors import DefinitionError

from .inertia import require_rigid


def _zeros() -> np.ndarray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint and its link, in the link's frame, which is the joint's frame.

    - `kind`: "revolute", "prismatic" or "fixed"; a continuous joint is revolute with infinite limits.
    - `parent`: name of the joint before it; None for the base.
    - `link`: name of the link that it moves.
    - `rotation`, `translation`: the link's frame in that of the link before it, at position 0 [3 3], [3], m.
    - `axis`: in the link's frame [3]; unused for a fixed joint.
    - `mass`: of the link, kg.
    - `center`: centre of mass [3], m.
    - `inertia`: about the centre of mass, in the link's axes [3 3], kg m².
    - `lower`, `upper`: position limits, rad or m.
    - `velocity`, `torque`, `torque_rate`: limits, rad/s or m/s, N m or N, N m/s or N/s.
    - `armature`: rotor inertia at the joint, kg m² or kg.
    - `viscous`, `coulomb`: friction, N m s/rad or N s/m, N m or N.

    Raises DefinitionError, naming joint or link, for an invalid value. `assemble` rejects a link without mass if
    nothing with mass moves with it.
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
                f"joint `{self.name}` must be `revolute`, `prismatic` or `fixed`; got `{self.kind}`; one that turns "
                "without end is revolute with infinite limits"
            )
        rotation = np.asarray(self.rotation, float)
        square = rotation.shape == (3, 3) and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        if not (square and np.linalg.det(rotation) > 0):
            raise DefinitionError(
                f"the frame of joint `{self.name}` must have orthonormal axes, right-handed; got {rotation.tolist()}"
            )
        _require_place(self.translation, f"the place of joint `{self.name}`")
        self._check_link()
        if self.kind != "fixed":
            self._check_motion()

    def _check_link(self) -> None:
        if not (math.isfinite(self.mass) and self.mass >= 0):
            raise DefinitionError(f"the mass of link `{self.link}` must be >= 0 kg and finite; got {self.mass:g}")
        _require_place(self.center, f"the centre of mass of link `{self.link}`")
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
        # A point or a thin rod may be fixed to a link that is neither; `assemble` looks at all that moves together.
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


def _require_place(place: np.ndarray, what: str) -> None:
    if np.shape(place) != (3,) or not np.isfinite(place).all():
        raise DefinitionError(f"{what} must be three finite numbers; got {np.asarray(place).tolist()}")
