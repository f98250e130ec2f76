"""Robots in a scenario file: the true arm, and the nominal arm that its law knows."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

from pydantic import Field, TypeAdapter, ValidationError, create_model

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
    """A robot from a few parameters, as those of the paper."""

    part: ClassVar[type[AbstractRobot]]
    plant: PartDescription
    nominal: PartDescription

    def build(self) -> Arms:
        """Build the true and the nominal robot, which differs from the true one only in its own parameters."""
        with located("plant"):
            true = self.plant.build()
        with located("nominal"):
            return Arms(true, self.part(**self.plant.parameters() | self.nominal.parameters()))


class ReadyDescription(AbstractArticulated):
    """A built-in arm."""

    def described(self) -> Articulated:
        """Return the arm with its maker's parameters."""
        return built_in_arm(self.kind).robot


class AbstractFile(AbstractArticulated):
    """Base class of descriptions of an arm from a file."""

    file: FileName
    """Its path, from the folder of the scenario file."""
    tip: str | None = None
    """The link, body or site whose frame is the tip; may be left out where there is only one end."""
    locked: dict[str, float] = Field(default={})
    """Joints that do not move, with their positions [rad or m]."""
    meshes: bool = False
    """True to require every mesh of the file; no run needs one."""
    inertias: Literal["given", "nearest", "strict"] = "given"
    """Inertias that no rigid body can have: replaced by the nearest if the change is at most 1 %, always, or never."""

    def described(self) -> Articulated | Coupled:
        """Read the arm from the file."""
        how: dict[str, Any] = {"tip": self.tip, "locked": self.locked, "meshes": self.meshes, "inertias": self.inertias}
        with messages_with_keys():
            return self._read(how)

    @abstractmethod
    def _read(self, how: dict[str, Any]) -> Articulated | Coupled: ...


class UrdfDescription(AbstractFile):
    """An arm from a URDF file."""

    kind: Literal["urdf"]
    packages: list[FileName] = Field(default=[])
    """Folders of the packages that it names."""
    limits: bool = True
    """True to read its limits of position, velocity and effort; otherwise all limits are infinite."""
    mimics: Literal["held", "followed"] = "held"
    """A joint that follows another and is not between base and tip: held, or moved with its leader."""

    arguments: dict[str, str] = Field(default={})
    """Arguments of a xacro file, by name."""

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
    """Differences of the true arm from that of the file, which replace the file's own ones."""

    def build(self) -> Arms:
        """Build the true robot, the nominal one, and the payload of the true one."""
        with located(f"file `{self.file}`"):
            return self.resolved().build()

    def resolved(self) -> AbstractRobotDescription:
        """Return the file's description, with the true arm's differences of this one.

        Raises DefinitionError if the file describes no arm of rigid links.
        """
        data, folder = read_robot(self.file)
        try:
            description = TypeAdapter(RobotDescription).validate_python(data, context={"folder": folder})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            # Without the kind, which pydantic puts before the keys.
            where = ".".join(["robot", *map(str, first["loc"][1:])])
            raise DefinitionError(f"`{where}` of the file `{self.file}`: {first['msg']}") from None
        if not isinstance(description, AbstractArticulated):
            raise DefinitionError(
                f"the robot of the file `{self.file}` must be an arm of rigid links; got {description.kind}"
            )
        differences = {field: getattr(self.plant, field) for field in self.plant.model_fields_set}
        return description.model_copy(update={"plant": description.plant.model_copy(update=differences)})


def _of_numbers(kind: str, part: type[AbstractRobot]) -> type[NumbersDescription]:
    true = plain_of(part, f"{part.__name__}.plant", doc="The true arm.")
    nominal = plain_of(part, f"{part.__name__}.nominal", optional=True, doc="The nominal arm, which the law knows.")
    called: Any = Literal[kind]
    model = create_model(
        part.__name__,
        __base__=NumbersDescription,
        __doc__=title_of(part),
        kind=(called, Field()),
        plant=(true, Field(description="The true arm.")),
        nominal=(
            nominal,
            Field(default=nominal(), description="The nominal arm; by default equal to the plant."),
        ),
    )
    model.part = part
    return model


def _ready(name: str) -> type[ReadyDescription]:
    kind: Any = (Literal[name], Field())
    return create_model(f"robot.{name}", __base__=ReadyDescription, __doc__=f"{built_in_title(name)}.", kind=kind)


MADE_OF_NUMBERS = {kind: part for kind, part in members_of(AbstractRobot).items() if part not in (Articulated, Coupled)}
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
