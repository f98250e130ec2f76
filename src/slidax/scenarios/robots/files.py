"""Arms from files of other formats in a scenario file."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from slidax.robots import Articulated, from_mjcf, from_urdf

from .articulated import AbstractArticulated


class AbstractFile(AbstractArticulated):
    """What every description of an arm from a file is."""

    file: str
    """Its path; not from the scenario file's folder, but from the one that the command is run in."""
    tip: str | None = None
    """The link, body or site whose frame is the tip; may be left out where there is only one end."""
    locked: dict[str, float] = Field(default={})
    """Joints that do not move, with their positions [rad or m]."""
    meshes: bool = False
    """Whether every mesh that it names must be there."""
    inertias: Literal["given", "nearest"] = "given"
    """What to do with an inertia that no rigid body can have: refuse it, or take the nearest that one can."""

    def _how(self) -> dict[str, Any]:
        return {"tip": self.tip, "locked": self.locked, "meshes": self.meshes, "inertias": self.inertias}


class UrdfDescription(AbstractFile):
    """An arm from a URDF file."""

    kind: Literal["urdf"]
    packages: list[str] = Field(default=[])
    """Folders in which the packages are that it names."""

    def described(self) -> Articulated:
        """The arm as the file has it."""
        return from_urdf(self.file, packages=self.packages, **self._how())


class MjcfDescription(AbstractFile):
    """An arm from an MJCF file."""

    kind: Literal["mjcf"]

    def described(self) -> Articulated:
        """The arm as the file has it."""
        return from_mjcf(self.file, **self._how())
