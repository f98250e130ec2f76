"""Robots in a scenario file: the arm that moves, and the arm as its law knows it."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

from pydantic import Field, TypeAdapter, ValidationError, create_model

from slidax import robots
from slidax._errors import DefinitionError, located
from slidax.parts import members_of
from slidax.robots import (
    AbstractRobot,
    Articulated,
    Coupled,
    built_in_arm,
    built_in_names,
    built_in_title,
    from_mjcf,
    from_urdf,
)

from .base import FileName
from .derived import PartDescription, plain_of, title_of
from .robot_file import messages_with_keys, read_robot
from .true_and_nominal import AbstractArticulated, AbstractRobotDescription, Arms, TrueArm


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


class ReadyDescription(AbstractArticulated):
    """An arm that needs no file."""

    def described(self) -> Articulated:
        """The arm by its maker's numbers."""
        return built_in_arm(self.kind).robot


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
    inertias: Literal["given", "nearest", "strict"] = "given"
    """Inertias that no rigid body can have: replaced by the nearest if the change is at most 1 %, always, or never."""

    def described(self) -> Articulated | Coupled:
        """The arm as the file has it; the file's own path is no part of the path in a scenario."""
        how: dict[str, Any] = {"tip": self.tip, "locked": self.locked, "meshes": self.meshes, "inertias": self.inertias}
        with messages_with_keys():
            return self._read(how)

    @abstractmethod
    def _read(self, how: dict[str, Any]) -> Articulated | Coupled: ...


class UrdfDescription(AbstractFile):
    """An arm from a URDF file."""

    kind: Literal["urdf"]
    packages: list[FileName] = Field(default=[])
    """Folders in which the packages are that it names."""
    limits: bool = True
    """Whether to read its limits of position, velocity and effort; without them all are infinite."""
    mimics: Literal["held", "followed"] = "held"
    """A joint that follows another and is not between base and tip: held, or moved with its leader."""

    arguments: dict[str, str] = Field(default={})
    """Values of the arguments of a xacro file, by name."""

    def _read(self, how: dict[str, Any]) -> Articulated | Coupled:
        how |= {"limits": self.limits, "mimics": self.mimics, "arguments": self.arguments}
        return from_urdf(self.file, packages=self.packages, **how)


class MjcfDescription(AbstractFile):
    """An arm from an MJCF file."""

    kind: Literal["mjcf"]

    def _read(self, how: dict[str, Any]) -> Articulated | Coupled:
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
    return create_model(f"robot.{name}", __base__=ReadyDescription, __doc__=f"{built_in_title(name)}.", kind=kind)


MADE_OF_NUMBERS = {
    kind: part for kind, part in members_of(robots, AbstractRobot).items() if part not in (Articulated, Coupled)
}
if TYPE_CHECKING:
    RobotDescription = AbstractRobotDescription
else:
    RobotDescription = Annotated[
        Union[  # noqa: UP007
            tuple(_of_numbers(kind, part) for kind, part in MADE_OF_NUMBERS.items())
            + tuple(_ready(name) for name in built_in_names())
            + (UrdfDescription, MjcfDescription, IdentifiedDescription)
        ],
        Field(discriminator="kind"),
    ]
