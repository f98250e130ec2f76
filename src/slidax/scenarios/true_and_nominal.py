"""The true and the nominal arm in the description of a robot."""

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
"""Former names of differences of the true arm, which old files have."""


class Arms(NamedTuple):
    """The arms of a scenario.

    - `true`, `nominal`: the true arm, and the arm that the law knows.
    - `load`: payload of the true arm.
    """

    true: AbstractRobot
    nominal: AbstractRobot
    load: Load | None = None

    @property
    def limits(self) -> JointLimits | None:
        """Joint limits from the data sheet; None without a data sheet."""
        return self.nominal.limits if isinstance(self.nominal, Articulated | Coupled) else None


class AbstractRobotDescription(AbstractDescription):
    """Base class of descriptions of a robot."""

    kind: Any

    @abstractmethod
    def build(self) -> Arms:
        """Build the true robot, the nominal one, and the payload of the true one."""

    def resolved(self) -> AbstractRobotDescription:
        """Return the description with the content of its file, so that each number has a path."""
        return self


class LoadDescription(AbstractDescription):
    """Payload at the tip."""

    mass: float = same(Payload, "mass", required=True)
    center: Annotated[list[float], Field(min_length=3, max_length=3)] = same(Payload, "center")
    inertia: float | Annotated[list[float], Field(min_length=3, max_length=6)] = 0.0
    """About the centre of mass [kg m²]: one number for a ball, the moments xx, yy, zz, or these with xy, xz, yz."""
    attached: float = same(Load, "attached")
    released: float | None = same(Load, "released", default=None, source="never let go")

    def build(self) -> Load:
        """Build the payload."""
        inertia = as_array(inertia_of(self.inertia) if isinstance(self.inertia, list) else self.inertia)
        payload = Payload(mass=as_array(self.mass), center=as_array(self.center), inertia=inertia)
        if self.released is None:
            return Load(payload, as_array(self.attached))
        return Load(payload, as_array(self.attached), as_array(self.released))


class TrueArm(plain_of(Mismatch, "Mismatch")):  # type: ignore[misc]  # made of the part's declarations
    """Differences of the true arm from the nominal one."""

    load: LoadDescription | None = None
    """Payload at the tip, and its times."""

    @model_validator(mode="before")
    @classmethod
    def _by_present_names(cls, data: Any) -> Any:
        return {RENAMED.get(key, key): value for key, value in data.items()} if isinstance(data, dict) else data

    def build(self, **more: Any) -> Mismatch:
        """Build the mismatch; `more` is empty."""
        with located("load"):
            load = None if self.load is None else self.load.build()
        return Mismatch(**{name: value for name, value in self.parameters().items() if name != "load"}, load=load)


class NominalArm(AbstractDescription):
    """Knowledge of the law in addition to the arm's own description."""

    armature: Numbers | None = same(Articulated, "armature", default=None, source="the arm's description")
    load: LoadDescription | None = None
    """Payload that the law knows, at the tip for the whole run, such as a gripper."""
    links: LinksDescription | None = None
    """Inertial parameters of the links, in place of the arm's description, as from an identification."""
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = same(
        Articulated, "gravity_vector", default=None, source="the arm's description"
    )

    def applied(self, robot: Articulated | Coupled) -> Articulated | Coupled:
        """Return the nominal arm for a described arm.

        With followers, each joint of the arm has its own numbers.

        Raises DefinitionError if a list does not have one entry per joint.
        """
        if isinstance(robot, Coupled):
            return eqx.tree_at(lambda coupled: coupled.arm, robot, self._known(robot.arm))
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
    """Base class of descriptions of an arm with rigid links."""

    plant: TrueArm = TrueArm()
    """Differences of the true arm from the nominal one."""
    nominal: NominalArm = NominalArm()
    """Knowledge of the law in addition to the arm's own description."""

    @abstractmethod
    def described(self) -> Articulated | Coupled:
        """Return the described arm."""

    def build(self) -> Arms:
        described = self.described()
        with located("nominal"):
            nominal = self.nominal.applied(described)
        with located("plant"):
            mismatch = self.plant.build()
            return Arms(mismatch.applied(nominal), nominal, mismatch.load)
