"""Robots in a scenario file: the true arm, and the nominal arm that the law knows."""

from __future__ import annotations

import re
import warnings
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Union

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from pydantic import Field, TypeAdapter, ValidationError, create_model

from slidax.arms.arm import AbstractRobot, JointLimits, Payload
from slidax.arms.articulated import Articulated
from slidax.arms.built_in import built_in_arm, built_in_names, built_in_title
from slidax.arms.coupled import Coupled
from slidax.arms.files.mjcf import from_mjcf
from slidax.arms.files.urdf import from_urdf
from slidax.arms.joint import require_rigid
from slidax.arms.mismatch import Mismatch, TimedPayload
from slidax.core.errors import DefinitionError, as_array, each_of, locate_errors, static_value
from slidax.core.part import members_of

from .descriptions import (
    AbstractDescription,
    FileName,
    Numbers,
    PartDescription,
    input_field,
    plain_of,
    same_field,
    title_of,
)
from .yaml_text import read_yaml_file

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]


def inertia_of(entries: list[float]) -> np.ndarray:
    """Return the inertia matrix [3 3], kg m², from xx, yy, zz, and optionally xy, xz, yz.

    Raises DefinitionError for another number of entries.
    """
    if len(entries) not in (3, 6):
        raise DefinitionError(
            f"must have 3 entries (xx, yy, zz) or 6 (and xy, xz, yz); got {len(entries)}", where="inertia"
        )
    xx, yy, zz, xy, xz, yz = [*entries, 0.0, 0.0, 0.0][:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class LinksDescription(AbstractDescription):
    """Inertial parameters of all links, an entry for each joint, in the joint's frame."""

    mass: list[float] = input_field("masses", "kg")
    center: list[Three] = input_field("centres of mass", "m")
    inertia: list[Six] = input_field("inertias about the centres of mass, xx, yy, zz, xy, xz, yz", "kg m²")

    def applied(self, robot: Articulated) -> Articulated:
        """Return a copy of the arm whose links have these parameters.

        Raises DefinitionError if their number differs from the arm's, or no rigid body has such parameters.
        """
        self.require_joints(robot.joints)
        if min(self.mass) < 0:
            raise DefinitionError(f"must be >= 0 kg; got {min(self.mass):g}", where="mass")
        inertias = [inertia_of(entries) for entries in self.inertia]
        for name, inertia in zip(robot.link_names, inertias, strict=True):
            require_rigid(inertia, f"the inertia of `{name}`", moves=False)
        return eqx.tree_at(
            lambda arm: (arm.masses, arm.centers, arm.inertias),
            robot,
            (as_array(self.mass), as_array(self.center), as_array(inertias)),
        )


class Arms(NamedTuple):
    """The arms of a scenario.

    - `true`, `nominal`: the true arm, and the arm that the law knows.
    - `load`: payload of the true arm.
    """

    true: AbstractRobot
    nominal: AbstractRobot
    load: TimedPayload | None = None

    @property
    def limits(self) -> JointLimits | None:
        """Joint limits from the data sheet; None without a data sheet."""
        return self.nominal.limits if isinstance(self.nominal, Articulated | Coupled) else None


class AbstractRobotDescription(AbstractDescription):
    """Base class of descriptions of a robot."""

    kind: Any

    @abstractmethod
    def build(self) -> Arms:
        """Build the true arm, the nominal arm that the law knows, and the payload of the true arm."""

    def resolved(self) -> AbstractRobotDescription:
        """Return the description with the content of its file in place of the file's name, so each value has a path."""
        return self


class LoadDescription(AbstractDescription):
    """Payload at the tip."""

    mass: float = same_field(Payload, "mass", required=True)
    center: Annotated[list[float], Field(min_length=3, max_length=3)] = same_field(Payload, "center")
    inertia: float | Annotated[list[float], Field(min_length=3, max_length=6)] = 0.0
    """Inertia about the centre of mass [kg m²]: a number for a ball, or xx, yy, zz, optionally with xy, xz, yz."""
    attached: float = same_field(TimedPayload, "attached")
    released: float | None = same_field(TimedPayload, "released", default=None, source="never released")

    def build(self) -> TimedPayload:
        """Build the payload."""
        inertia = as_array(inertia_of(self.inertia) if isinstance(self.inertia, list) else self.inertia)
        payload = Payload(mass=as_array(self.mass), center=as_array(self.center), inertia=inertia)
        if self.released is None:
            return TimedPayload(payload, as_array(self.attached))
        return TimedPayload(payload, as_array(self.attached), as_array(self.released))


class TrueArm(plain_of(Mismatch, "Mismatch")):  # type: ignore[misc]  # made of the part's declarations
    """Differences of the true arm from the nominal one."""

    load: LoadDescription | None = None
    """Payload at the tip, with its attachment and release times."""

    def build(self, **more: Any) -> Mismatch:
        """Build the mismatch; `more` is empty."""
        with locate_errors("load"):
            load = None if self.load is None else self.load.build()
        return Mismatch(**{name: value for name, value in self.parameters().items() if name != "load"}, load=load)


class NominalArm(AbstractDescription):
    """The arm as the law knows it: values that complete or replace those of the arm's description."""

    armature: Numbers | None = same_field(Articulated, "armature", default=None, source="the arm's description")
    viscous: Numbers | None = same_field(Articulated, "viscous", default=None, source="the arm's description")
    load: LoadDescription | None = None
    """Payload that the law knows, at the tip for the whole run, such as a gripper."""
    links: LinksDescription | None = None
    """Inertial parameters of the links instead of those in the arm's description, as from an identification."""
    zero: Numbers = input_field("encoder offset: true position minus encoder position", "rad or m", default=0.0)
    gravity: Annotated[list[float], Field(min_length=3, max_length=3)] | None = same_field(
        Articulated, "gravity_vector", default=None, source="the arm's description"
    )

    def applied(self, robot: Articulated | Coupled) -> Articulated | Coupled:
        """Return the nominal arm: the arm of the description with these values.

        In an arm with joints that follow others, a list has an entry for each joint, also for a following joint.

        Raises DefinitionError if a list does not have an entry for each joint.
        """
        if isinstance(robot, Coupled):
            return eqx.tree_at(lambda coupled: coupled.arm, robot, self._known(robot.arm))
        return self._known(robot)

    def _known(self, robot: Articulated) -> Articulated:
        for name in ("armature", "viscous"):
            if getattr(self, name) is not None:
                values = self._per_joint(name, robot.joints)
                robot = eqx.tree_at(attrgetter(name), robot, values)
        if self.links is not None:
            with locate_errors("links"):
                robot = self.links.applied(robot)
        if "zero" in self.model_fields_set:
            robot = robot.with_zero(self._per_joint("zero", robot.joints))
        if self.gravity is not None:
            robot = eqx.tree_at(lambda arm: arm.gravity_vector, robot, as_array(self.gravity))
        if self.load is not None:
            with locate_errors("load"):
                load = self.load.build()
                if self.load.attached or self.load.released is not None:
                    raise DefinitionError(
                        "the law cannot know a load with `attached` or `released`; write the load under `plant`"
                    )
            robot = eqx.tree_at(lambda arm: arm.payload, robot, load.payload)
        return robot

    def _per_joint(self, name: str, joints: int) -> Array:
        values = as_array(getattr(self, name))
        if values.shape not in ((), (joints,)):
            message = f"must be one number or one for {each_of(joints, 'joint')}; got {values.shape[0]}"
            raise DefinitionError(message, where=name)
        if name != "zero" and (static_value(values) < 0).any():
            raise DefinitionError(f"must be >= 0; got {getattr(self, name)}", where=name)
        return jnp.broadcast_to(values, (joints,))


class AbstractArticulated(AbstractRobotDescription):
    """Base class of descriptions of an arm with rigid links."""

    plant: TrueArm = TrueArm()
    """Differences of the true arm from the nominal one."""
    nominal: NominalArm = NominalArm()
    """The arm as the law knows it: values that complete or replace those of the arm's description."""

    @abstractmethod
    def described(self) -> Articulated | Coupled:
        """Return the arm as the robot's file or data sheet describes it."""

    def build(self) -> Arms:
        described = self.described()
        with locate_errors("nominal"):
            nominal = self.nominal.applied(described)
        with locate_errors("plant"):
            mismatch = self.plant.build()
            return Arms(mismatch.applied(nominal), nominal, mismatch.load)


ARGUMENT = re.compile(r"\b(tip|locked|limits|meshes|inertias|mimics)=(\"\w+\"|\{[^{}]*\}|\w+)")
"""Arguments of the readers of robot files, as their messages write them in remedies."""


def read_robot(path: str | Path) -> tuple[dict[str, Any], Path]:
    """Return the mapping `robot` in a YAML file, and the folder to which its file names are relative.

    Raises DefinitionError if the file cannot be read or has no such mapping.
    """
    path = Path(path)
    data = read_yaml_file(path)
    robot = data.get("robot") if isinstance(data, dict) else None
    if not isinstance(robot, dict) or not isinstance(robot.get("kind"), str):
        raise DefinitionError(f"the file `{path}` has no mapping `robot` with a `kind`")
    if robot["kind"] == "identified":
        raise DefinitionError(
            f"the robot in the file `{path}` is `identified`, a reference to another file: use that file directly"
        )
    return robot, path.parent


@contextmanager
def messages_with_keys() -> Iterator[None]:
    """Reword errors and warnings of the robot-file readers for users of scenario files, inside a `with` block.

    A Python argument in a message becomes a key of the file: `mimics="followed"` becomes `mimics: followed`.
    """
    with warnings.catch_warnings(record=True) as assumed:
        warnings.simplefilter("always")
        try:
            yield
        except DefinitionError as error:
            # A path inside the robot file is not a path in the scenario.
            where = "file" if error.where else ""
            raise DefinitionError(_as_keys(str(error)), where=where).offering(error.setting) from error
    for warning in assumed:
        warnings.warn(_as_keys(str(warning.message)), warning.category, stacklevel=4)


def _as_keys(text: str) -> str:
    text = re.sub(r"\bpackages=\{[^{}]*\}", "packages: [FOLDER]", text)
    return ARGUMENT.sub(lambda match: f"{match[1]}: {match[2].strip(chr(34))}", text)


class NumbersDescription(AbstractRobotDescription):
    """A robot from a few parameters, such as those of the paper."""

    part: ClassVar[type[AbstractRobot]]
    plant: PartDescription
    nominal: PartDescription

    def build(self) -> Arms:
        """Build the true robot, and the nominal robot, which has the true parameters except for those in `nominal`."""
        with locate_errors("plant"):
            true = self.plant.build()
        with locate_errors("nominal"):
            return Arms(true, self.part(**self.plant.parameters() | self.nominal.parameters()))


class BuiltInDescription(AbstractArticulated):
    """A built-in arm."""

    def described(self) -> Articulated:
        return built_in_arm(self.kind).robot


class AbstractFile(AbstractArticulated):
    """Base class of descriptions of an arm from a file."""

    file: FileName
    """Path of the file, relative to the folder of the scenario file."""
    tip: str | None = None
    """Link, body or site whose frame is the tip; optional if the arm has only one end."""
    locked: dict[str, float] = Field(default={})
    """Joints that do not move, with their positions [rad or m]."""
    meshes: bool = False
    """True to require every mesh of the file. A run needs only those from which an MJCF file computes inertias."""
    inertias: Literal["given", "nearest", "strict"] = "given"
    """Replacement of inertias that no rigid body can have by the nearest valid one: `given` if the change is at most
    1 %, `nearest` always, `strict` never. Without a replacement they are errors."""

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
    """Folders of the packages that the file names."""
    limits: bool = True
    """True to read the limits of position, velocity and effort; otherwise all limits are infinite."""
    mimics: Literal["held", "followed"] = "held"
    """Joints that follow another and are not between base and tip: held, or moved with their leader."""

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
    """Path of the file, relative to the folder of the scenario file."""
    plant: TrueArm = TrueArm()
    """Differences of the true arm from the arm of the file; they replace those in the file."""

    def build(self) -> Arms:
        with locate_errors(f"file `{self.file}`"):
            return self.resolved().build()

    def resolved(self) -> AbstractRobotDescription:
        """Return the description in the file, with the values in `plant` in place of the file's own values there.

        `plant` states how the simulated arm differs from the arm that the law knows.

        Raises DefinitionError if the file describes no arm of rigid links.
        """
        data, folder = read_robot(self.file)
        try:
            description = TypeAdapter(RobotDescription).validate_python(data, context={"folder": folder})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            # Skip the kind, which pydantic puts before the keys.
            where = ".".join(["robot", *map(str, first["loc"][1:])])
            raise DefinitionError(f"`{where}` of the file `{self.file}`: {first['msg']}") from None
        if not isinstance(description, AbstractArticulated):
            raise DefinitionError(
                f"the robot of the file `{self.file}` must be an arm of rigid links; got {description.kind}"
            )
        differences = {field: getattr(self.plant, field) for field in self.plant.model_fields_set}
        return description.model_copy(update={"plant": description.plant.model_copy(update=differences)})


def _description_of_numbers(kind: str, part: type[AbstractRobot]) -> type[NumbersDescription]:
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


def _built_in_description(name: str) -> type[BuiltInDescription]:
    kind: Any = (Literal[name], Field())
    return create_model(f"robot.{name}", __base__=BuiltInDescription, __doc__=f"{built_in_title(name)}.", kind=kind)


ROBOTS_OF_NUMBERS = {
    kind: part for kind, part in members_of(AbstractRobot).items() if part not in (Articulated, Coupled)
}
if TYPE_CHECKING:
    RobotDescription = AbstractRobotDescription
else:
    RobotDescription = Annotated[
        Union[  # noqa: UP007
            tuple(_description_of_numbers(kind, part) for kind, part in ROBOTS_OF_NUMBERS.items())
            + tuple(_built_in_description(name) for name in built_in_names())
            + (UrdfDescription, MjcfDescription, IdentifiedDescription)
        ],
        Field(discriminator="kind"),
    ]
