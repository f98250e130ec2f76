"""Files that a file names: each must be below the studio's folder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from slidax.arms.files.source import elements, read_robot_file
from slidax.core.errors import DefinitionError, plain_name
from slidax.scenarios.yaml_text import read_yaml

from .files import Folder, OutsideError

YAML, ROBOTS = (".yaml", ".yml"), (".urdf", ".xml", ".mjcf")

MOST = 32_000_000
"""Size of a file to search at most [bytes]."""

FILES = 100
"""Files that refer to each other at most."""

NAMING = re.compile(r"(^|\.)(file|scenario|robot|packages|log)(\.\d+)?$")
"""Keys, and paths of values, that name files."""

FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of MJCF with search folders of MuJoCo."""


def require_beneath(folder: Folder, data: Any, where: Path) -> None:
    """Raise OutsideError if `data` refers to a file outside the folder, directly or indirectly.

    Missing and unreadable files are left to the reader.

    - `folder`: of the studio.
    - `data`: mappings, lists and values of a scenario, a study, requirements, or changes by path.
    - `where`: folder that relative names start from.
    """
    _Walk(folder).through(data, where)


def require_file_beneath(folder: Folder, place: Path) -> None:
    """Raise OutsideError if the file at `place` refers to a file outside the `folder`."""
    _Walk(folder).file(place)


FILES_OF_MJCF = ("file", "fileup", "filedown", "fileleft", "fileright", "filefront", "fileback")
"""Attributes of MJCF with files that MuJoCo opens."""


class _Walk:
    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._visited: set[Path] = set()

    def through(self, data: Any, where: Path) -> None:
        if isinstance(data, list | tuple):
            for part in data:
                self.through(part, where)
        if not isinstance(data, dict):
            return
        for key, value in data.items():
            if isinstance(key, str) and NAMING.search(key):
                for name in _texts(value):
                    self._named(key, name, where)
            self.through(value, where)
        # The page must not learn which meshes exist in other folders.
        if data.get("meshes") is True and isinstance(data.get("file"), str):
            self._meshes(where / data["file"])

    def file(self, place: Path) -> None:
        if place in self._visited:
            return
        if place.suffix.lower() == ".xacro":
            raise DefinitionError(
                f"`{plain_name(place.name)}` is xacro, which the studio does not expand: run `xacro FILE > "
                "robot.urdf` first"
            )
        self._visited.add(place)
        if len(self._visited) > FILES:
            raise DefinitionError(f"more than {FILES} files refer to each other")
        try:
            content = self._folder.content(place, place.name, MOST)
        except OutsideError:
            raise
        except DefinitionError:
            return
        if place.suffix.lower() in YAML:
            try:
                data = read_yaml(content.decode("utf-8"))
            except (DefinitionError, UnicodeDecodeError):
                return
            self.through(data, place.parent)
        elif place.suffix.lower() in ROBOTS:
            self._robot(content, place)

    def _named(self, key: str, name: str, where: Path) -> None:
        suffix = Path(name).suffix.lower() if "\0" not in name else ".yaml"
        if suffix == ".xacro":
            raise DefinitionError(
                f"`{plain_name(name)}` is xacro, which the studio does not expand: run `xacro FILE > robot.urdf` first"
            )
        word = key.split(".")[-1] in ("scenario", "robot") and suffix not in (*YAML, *ROBOTS)
        if word and "/" not in name and "\\" not in name:
            return
        place = self._beneath(where, name)
        if place.suffix.lower() in (*YAML, *ROBOTS):
            self.file(place)

    def _beneath(self, where: Path, name: str) -> Path:
        if "\0" in name:
            raise OutsideError("a file name contains NUL")
        if "\\" in name or re.match(r"[A-Za-z]:", name) or name.startswith("~"):
            raise OutsideError(f"`{plain_name(name)}` is not a path below the studio's folder")
        place = where / name
        return place if place.resolve() == self._folder.root else self._folder.beneath(place, name)

    def _robot(self, content: bytes, place: Path) -> None:
        """MuJoCo opens the files that an MJCF file names; for a URDF file none is opened."""
        text = content.decode("utf-8", "replace").lstrip("\ufeff")
        if "<mujoco" not in text or "<robot" in text:
            return
        try:
            root = read_robot_file(text, "mujoco", "from_urdf reads <robot>").root
        except DefinitionError as error:
            raise DefinitionError(f"`{plain_name(place.name)}`: {error}") from None
        bases = [place.parent, *self._asset_folders(root, place.parent)]
        for element, name in _attributes(root, FILES_OF_MJCF):
            if ":" in name:
                raise OutsideError(
                    f"`{plain_name(name)}` in `{plain_name(place.name)}` is not a file below the studio's folder"
                )
            for base in bases:
                path = self._beneath(base, name)
                if element in ("include", "model"):
                    self.file(path)

    def _asset_folders(self, root: Any, where: Path) -> Iterator[Path]:
        for _, name in _attributes(root, FOLDERS):
            yield self._beneath(where, name)

    def _meshes(self, place: Path) -> None:
        try:
            content = self._folder.content(self._folder.beneath(place, place.name), place.name, MOST)
            root = read_robot_file(content.decode("utf-8", "replace").lstrip("\ufeff"), "robot", "").root
        except OutsideError:
            raise
        except DefinitionError:
            return
        for _, name in _attributes(root, ("filename",)):
            self._beneath(place.parent, re.sub(r"^(file://|(package|model):///?)", "", name))


def _attributes(root: Any, names: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    for _, element in elements(root):
        for name in names:
            value = element.get(name)
            if value:
                yield element.tag, value


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _texts(part)
    elif isinstance(value, dict):
        for part in value.values():
            yield from _texts(part)
