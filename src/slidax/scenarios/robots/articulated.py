"""Arms of rigid links in a scenario file: ready ones, and what the true arm has that the law does not know."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from pydantic import Field

from slidax._errors import DefinitionError, as_array, known, located
from slidax.robots import Articulated, Load, Mismatch, Payload, ready

from ..base import Description, Numbers
from .arms import Arms


class LoadDescription(Description):
    """What the tip carries."""

    mass: Annotated[float, Field(ge=0)]
    """[kg]"""
    center: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(default=[0.0, 0.0, 0.0])
    """Centre of mass in the tip's frame [m]."""
    inertia: float | Annotated[list[float], Field(min_length=3, max_length=3)] = 0.0
    """About the centre of mass: one number for a ball, or the moments about the tip's axes [kg m²]."""
    attached: float = 0.0
    """From when [s]."""
    released: float | None = None
    """Until when [s]; never let go if not given."""

    def build(self) -> Load:
        """The load."""
        inertia = as_array(np.diag(self.inertia) if isinstance(self.inertia, list) else self.inertia)
        payload = Payload(mass=as_array(self.mass), center=as_array(self.center), inertia=inertia)
        if self.released is None:
            return Load(payload, as_array(self.attached))
        return Load(payload, as_array(self.attached), as_array(self.released))


class TrueArm(Description):
    """How the arm that moves differs from the nominal one."""

    mass: Numbers = 1.0
    """Factor on the masses of the links: 0.85 is an arm 15 % lighter than its law believes."""
    inertia: Numbers | None = None
    """Factor on their inertias; as `mass` if not given."""
    viscous: Numbers | None = None
    """Viscous friction [N m s/rad or N s/m]; the nominal arm's if not given."""
    coulomb: Numbers | None = None
    """Coulomb friction [N m or N]; the nominal arm's if not given."""
    armature: Numbers | None = None
    """Inertia of the rotors, seen from the joints [kg m² or kg]; the nominal arm's if not given."""
    load: LoadDescription | None = None
    """What the tip carries, and when."""

    def build(self) -> Mismatch:
        """The difference."""
        with located("load"):
            load = None if self.load is None else self.load.build()
        given = self.model_dump(exclude={"load", "mass", "inertia"}, exclude_none=True)
        return Mismatch(mass_factor=self.mass, inertia_factor=self.inertia, **given, load=load)


class NominalArm(Description):
    """What the law knows beside the arm's own description."""

    armature: Numbers | None = None
    """Inertia of the rotors, seen from the joints [kg m² or kg]; the description's if not given."""
    load: LoadDescription | None = None
    """What the law knows to be at the tip from the start to the end, such as a gripper."""
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    """Its acceleration in the base's frame [m/s²]."""

    def applied(self, robot: Articulated) -> Articulated:
        """The arm as the law knows it.

        - `robot`: as it is described.

        Raises DefinitionError if a list has another length than the arm has joints.
        """
        if self.armature is not None:
            robot = eqx.tree_at(lambda arm: arm.armature, robot, self._armature(robot.joints))
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
            message = f"must be one number or one for each of the {joints} joints; got {armature.shape[0]}"
            raise DefinitionError(message, where="armature")
        if (known(armature) < 0).any():
            raise DefinitionError(f"must be >= 0; got {self.armature}", where="armature")
        return jnp.broadcast_to(armature, (joints,))


class AbstractArticulated(Description):
    """What every description of an arm of rigid links is."""

    plant: TrueArm = TrueArm()
    """How the arm that moves differs from the nominal one."""
    nominal: NominalArm = NominalArm()
    """What the law knows beside the arm's own description."""

    @abstractmethod
    def described(self) -> Articulated:
        """The arm as it is described."""

    def build(self) -> Arms:
        """The true robot, the nominal one, and what the true one carries."""
        described = self.described()
        with located("nominal"):
            nominal = self.nominal.applied(described)
        with located("plant"):
            mismatch = self.plant.build()
            return Arms(mismatch.applied(nominal), nominal, mismatch.load)


class AbstractReady(AbstractArticulated):
    """What every description of an arm that needs no file is."""

    kind: Any

    def described(self) -> Articulated:
        """The arm by its maker's numbers."""
        return ready.read(self.kind).robot


class PandaDescription(AbstractReady):
    """Franka Emika Panda, seven joints."""

    kind: Literal["panda"]


class Ur5eDescription(AbstractReady):
    """Universal Robots UR5e, six joints."""

    kind: Literal["ur5e"]


class Iiwa14Description(AbstractReady):
    """KUKA LBR iiwa 14 R820, seven joints."""

    kind: Literal["iiwa14"]


class Xarm7Description(AbstractReady):
    """UFactory xArm7, seven joints."""

    kind: Literal["xarm7"]


class Gen3Description(AbstractReady):
    """Kinova Gen3 with seven joints."""

    kind: Literal["gen3"]
