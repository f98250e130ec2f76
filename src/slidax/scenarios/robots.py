"""Robots in a scenario file: the arm that moves, and the arm as its law knows it."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Union

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array
from pydantic import Field, TypeAdapter, ValidationError, create_model, model_validator

from slidax import robots
from slidax._errors import DefinitionError, as_array, known, located
from slidax.parts import members_of
from slidax.robots import AbstractRobot, Articulated, JointLimits, Load, Mismatch, Payload, from_mjcf, from_urdf, ready

from .base import AbstractDescription, FileName, Numbers, same
from .derived import PartDescription, plain_of, title_of
from .links import LinksDescription, inertia_of
from .robot_file import read_robot

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
        return self.nominal.limits if isinstance(self.nominal, Articulated) else None


class AbstractRobotDescription(AbstractDescription):
    """What every description of a robot is."""

    kind: Any

    @abstractmethod
    def build(self) -> Arms:
        """The true robot, the nominal one, and what the true one carries."""

    def resolved(self) -> AbstractRobotDescription:
        """The same with what a file says of it written out, so that each of its numbers has a path."""
        return self


class NumbersDescription(AbstractRobotDescription):
    """A robot that is made of a few numbers, as those of the paper."""

    part: ClassVar[type[AbstractRobot]]
    plant: PartDescription
    nominal: PartDescription

    def build(self) -> Arms:
        """The true robot and the nominal one, which is as the true one but for what is said of it."""
        with located("plant"):
            true = self.plant.build()
        with located("nominal"):
            return Arms(true, self.part(**self.plant.parameters() | self.nominal.parameters()))


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

    def applied(self, robot: Articulated) -> Articulated:
        """The arm as the law knows it.

        - `robot`: as it is described.

        Raises DefinitionError if a list has another length than the arm has joints.
        """
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
            message = f"must be one number or one for each of the {joints} joints; got {armature.shape[0]}"
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


class ReadyDescription(AbstractArticulated):
    """An arm that needs no file."""

    def described(self) -> Articulated:
        """The arm by its maker's numbers."""
        return ready.read(self.kind).robot


class AbstractFile(AbstractArticulated):
    """What every description of an arm from a file is."""

    file: FileName
    """Its path, from the folder of the scenario file."""
    tip: str | None = None
    """The link, body or site whose frame is the tip; may be left out where there is only one end."""
    locked: dict[str, float] = Field(default={})
    """Joints that do not move, with their positions [rad or m]."""
    meshes: bool = False
    """Whether every mesh that it names must be there; none is needed for a run."""
    inertias: Literal["given", "nearest"] = "given"
    """An inertia that no rigid body can have: refused, or replaced by the nearest that one can."""

    def described(self) -> Articulated:
        """The arm as the file has it; the file's own path is no part of the path in a scenario."""
        how: dict[str, Any] = {"tip": self.tip, "locked": self.locked, "meshes": self.meshes, "inertias": self.inertias}
        try:
            return self._read(how)
        except DefinitionError as error:
            raise DefinitionError(str(error), where="file" if error.where else "") from error

    @abstractmethod
    def _read(self, how: dict[str, Any]) -> Articulated: ...


class UrdfDescription(AbstractFile):
    """An arm from a URDF file."""

    kind: Literal["urdf"]
    packages: list[FileName] = Field(default=[])
    """Folders in which the packages are that it names."""

    def _read(self, how: dict[str, Any]) -> Articulated:
        return from_urdf(self.file, packages=self.packages, **how)


class MjcfDescription(AbstractFile):
    """An arm from an MJCF file."""

    kind: Literal["mjcf"]

    def _read(self, how: dict[str, Any]) -> Articulated:
        return from_mjcf(self.file, **how)


class IdentifiedDescription(AbstractRobotDescription):
    """An arm from a file with a mapping `robot`, as `slidax identify` writes it."""

    kind: Literal["identified"]
    file: FileName
    """Its path, from the folder of the scenario file."""
    plant: TrueArm = TrueArm()
    """How the arm that moves differs from that of the file; what is not given is as it says there."""

    def build(self) -> Arms:
        """The true robot, the nominal one, and what the true one carries."""
        with located(f"file `{self.file}`"):
            return self.resolved().build()

    def resolved(self) -> AbstractRobotDescription:
        """As the file describes it, with what is said here of the true arm.

        Raises DefinitionError if the file describes no arm of rigid links.
        """
        given, folder = read_robot(self.file)
        try:
            found = TypeAdapter(RobotDescription).validate_python(given, context={"folder": folder})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            # The first is the kind, which pydantic puts before the keys.
            where = ".".join(["robot", *map(str, first["loc"][1:])])
            raise DefinitionError(f"`{where}` of the file `{self.file}`: {first['msg']}") from None
        if not isinstance(found, AbstractArticulated):
            raise DefinitionError(
                f"the robot of the file `{self.file}` must be an arm of rigid links; got {found.kind}"
            )
        said = {field: getattr(self.plant, field) for field in self.plant.model_fields_set}
        return found.model_copy(update={"plant": found.plant.model_copy(update=said)})


def _of_numbers(kind: str, part: type[AbstractRobot]) -> type[NumbersDescription]:
    true = plain_of(part, f"{part.__name__}.plant", doc="The arm that moves.")
    nominal = plain_of(part, f"{part.__name__}.nominal", optional=True, doc="What the law believes of it.")
    called: Any = Literal[kind]
    model = create_model(
        part.__name__,
        __base__=NumbersDescription,
        __doc__=title_of(part),
        kind=(called, Field()),
        plant=(true, Field(description="The arm that moves.")),
        nominal=(nominal, Field(default=nominal(), description="The arm as the law knows it; else as the plant.")),
    )
    model.part = part
    return model


def _ready(name: str) -> type[ReadyDescription]:
    kind: Any = (Literal[name], Field())
    return create_model(f"robot.{name}", __base__=ReadyDescription, __doc__=f"{ready.title(name)}.", kind=kind)


MADE_OF_NUMBERS = {kind: part for kind, part in members_of(robots, AbstractRobot).items() if part is not Articulated}
if TYPE_CHECKING:
    RobotDescription = AbstractRobotDescription
else:
    RobotDescription = Annotated[
        Union[  # noqa: UP007
            tuple(_of_numbers(kind, part) for kind, part in MADE_OF_NUMBERS.items())
            + tuple(_ready(name) for name in ready.names())
            + (UrdfDescription, MjcfDescription, IdentifiedDescription)
        ],
        Field(discriminator="kind"),
    ]
