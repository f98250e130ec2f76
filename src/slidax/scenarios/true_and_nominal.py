"""What a description of a robot in a scenario file is made of: the true arm, and the arm as its law knows it."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array
from pydantic import Field, model_validator

from slidax._errors import DefinitionError, as_array, each_of, known, located
from slidax.robots import AbstractRobot, Articulated, Coupled, JointLimits, Load, Mismatch, Payload

from .base import AbstractDescription, Numbers, same
from .derived import plain_of
from .links import LinksDescription, inertia_of

RENAMED = {"mass": "mass_factor", "inertia": "inertia_factor"}
"""Earlier names of what a true arm differs by, which files may still have."""


class Arms(NamedTuple):
    """What the description of a robot becomes.

    - `true`, `nominal`: the arm that moves, and the arm as the law knows it.
    - `load`: what the true one carries for some time.
    """

    true: AbstractRobot
    nominal: AbstractRobot
    load: Load | None = None

    @property
    def limits(self) -> JointLimits | None:
        """Of the joints, by their data sheet; None if it has none."""
        return self.nominal.limits if isinstance(self.nominal, Articulated | Coupled) else None


class AbstractRobotDescription(AbstractDescription):
    """What every description of a robot is."""

    kind: Any

    @abstractmethod
    def build(self) -> Arms:
        """The true robot, the nominal one, and what the true one carries."""

    def resolved(self) -> AbstractRobotDescription:
        """The same with what a file says of it written out, so that each of its numbers has a path."""
        return self


class LoadDescription(AbstractDescription):
    """What the tip carries."""

    mass: float = same(Payload, "mass", required=True)
    center: Annotated[list[float], Field(min_length=3, max_length=3)] = same(Payload, "center")
    inertia: float | Annotated[list[float], Field(min_length=3, max_length=6)] = 0.0
    """About the centre of mass [kg m²]: one number for a ball, the moments xx, yy, zz, or these with xy, xz, yz."""
    attached: float = same(Load, "attached")
    released: float | None = same(Load, "released", default=None, source="never let go")

    def build(self) -> Load:
        """The load."""
        inertia = as_array(inertia_of(self.inertia) if isinstance(self.inertia, list) else self.inertia)
        payload = Payload(mass=as_array(self.mass), center=as_array(self.center), inertia=inertia)
        if self.released is None:
            return Load(payload, as_array(self.attached))
        return Load(payload, as_array(self.attached), as_array(self.released))


class TrueArm(plain_of(Mismatch, "Mismatch")):  # type: ignore[misc]  # made of the part's declarations
    """How the arm that moves differs from the nominal one."""

    load: LoadDescription | None = None
    """What the tip carries, and when."""

    @model_validator(mode="before")
    @classmethod
    def _by_present_names(cls, data: Any) -> Any:
        return {RENAMED.get(key, key): value for key, value in data.items()} if isinstance(data, dict) else data

    def build(self, **more: Any) -> Mismatch:
        """The difference.

        - `more`: nothing.
        """
        with located("load"):
            load = None if self.load is None else self.load.build()
        return Mismatch(**{name: value for name, value in self.parameters().items() if name != "load"}, load=load)


class NominalArm(AbstractDescription):
    """What the law knows beside the arm's own description."""

    armature: Numbers | None = same(Articulated, "armature", default=None, source="the arm's description")
    load: LoadDescription | None = None
    """What the law knows to be at the tip from the start to the end, such as a gripper."""
    links: LinksDescription | None = None
    """What the links weigh, in place of the arm's description, as from an identification."""
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = same(
        Articulated, "gravity_vector", default=None, source="the arm's description"
    )

    def applied(self, robot: Articulated | Coupled) -> Articulated | Coupled:
        """The arm as the law knows it.

        - `robot`: as it is described; of one with followers, each of its joints has its own numbers.

        Raises DefinitionError if a list has another length than the arm has joints.
        """
        if isinstance(robot, Coupled):
            return eqx.tree_at(lambda one: one.arm, robot, self._known(robot.arm))
        return self._known(robot)

    def _known(self, robot: Articulated) -> Articulated:
        if self.armature is not None:
            robot = eqx.tree_at(lambda arm: arm.armature, robot, self._armature(robot.joints))
        if self.links is not None:
            with located("links"):
                robot = self.links.applied(robot)
        if self.gravity is not None:
            robot = eqx.tree_at(lambda arm: arm.gravity_vector, robot, as_array(self.gravity))
        if self.load is not None:
            with located("load"):
                load = self.load.build()
                if self.load.attached or self.load.released is not None:
                    raise DefinitionError("a load that comes and goes cannot be known; write it under `plant`")
            robot = eqx.tree_at(lambda arm: arm.payload, robot, load.payload)
        return robot

    def _armature(self, joints: int) -> Array:
        armature = as_array(self.armature)
        if armature.shape not in ((), (joints,)):
            message = f"must be one number or one for {each_of(joints, 'joint')}; got {armature.shape[0]}"
            raise DefinitionError(message, where="armature")
        if (known(armature) < 0).any():
            raise DefinitionError(f"must be >= 0; got {self.armature}", where="armature")
        return jnp.broadcast_to(armature, (joints,))


class AbstractArticulated(AbstractRobotDescription):
    """What every description of an arm of rigid links is."""

    plant: TrueArm = TrueArm()
    """How the arm that moves differs from the nominal one."""
    nominal: NominalArm = NominalArm()
    """What the law knows beside the arm's own description."""

    @abstractmethod
    def described(self) -> Articulated | Coupled:
        """The arm as it is described."""

    def build(self) -> Arms:
        """The true robot, the nominal one, and what the true one carries."""
        described = self.described()
        with located("nominal"):
            nominal = self.nominal.applied(described)
        with located("plant"):
            mismatch = self.plant.build()
            return Arms(mismatch.applied(nominal), nominal, mismatch.load)
