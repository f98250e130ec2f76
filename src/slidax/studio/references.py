"""Check that a file refers, directly or indirectly, only to files below the studio's folder."""

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
"""Largest file that is searched for references [bytes]."""

FILES = 100
"""Largest number of files that are searched for references."""

NAMING = re.compile(r"(^|\.)(file|scenario|robot|packages|log)(\.\d+)?$")
"""Keys and dotted paths whose values are file names."""

FOLDERS = ("meshdir", "texturedir", "assetdir")
"""MJCF attributes that name folders in which MuJoCo searches files."""


def require_beneath(folder: Folder, data: Any, where: Path) -> None:
    """Raise OutsideError if `data` refers to a file outside the folder, directly or indirectly.

    Missing and unreadable files are ignored here: their reader reports them.

    - `folder`: the studio's folder.
    - `data`: parsed content of a scenario, a study or requirements, or changes by dotted path.
    - `where`: folder to which file names are relative.
    """
    _Walk(folder).through(data, where)


def require_file_beneath(folder: Folder, path: Path) -> None:
    """Raise OutsideError if the file at `path` refers to a file outside the `folder`."""
    _Walk(folder).file(path)


FILES_OF_MJCF = ("file", "fileup", "filedown", "fileleft", "fileright", "filefront", "fileback")
"""MJCF attributes with files that MuJoCo opens."""


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
        # Otherwise the page could test which mesh files exist in other folders.
        if data.get("meshes") is True and isinstance(data.get("file"), str):
            self._meshes(where / data["file"])

    def file(self, path: Path) -> None:
        if path in self._visited:
            return
        if path.suffix.lower() == ".xacro":
            raise DefinitionError(
                f"`{plain_name(path.name)}` is xacro, which the studio does not expand: run `xacro FILE > "
                "robot.urdf` first"
            )
        self._visited.add(path)
        if len(self._visited) > FILES:
            raise DefinitionError(
                f"the file refers, directly or through other files, to more than {FILES} files, which is the studio's "
                "limit: merge or remove some"
            )
        try:
            content = self._folder.content(path, path.name, MOST)
        except OutsideError:
            raise
        except DefinitionError:
            return
        if path.suffix.lower() in YAML:
            try:
                data = read_yaml(content.decode("utf-8"))
            except (DefinitionError, UnicodeDecodeError):
                return
            self.through(data, path.parent)
        elif path.suffix.lower() in ROBOTS:
            self._robot(content, path)

    def _named(self, key: str, name: str, where: Path) -> None:
        suffix = Path(name).suffix.lower() if "\0" not in name else ".yaml"
        if suffix == ".xacro":
            raise DefinitionError(
                f"`{plain_name(name)}` is xacro, which the studio does not expand: run `xacro FILE > robot.urdf` first"
            )
        word = key.split(".")[-1] in ("scenario", "robot") and suffix not in (*YAML, *ROBOTS)
        if word and "/" not in name and "\\" not in name:
            return
        path = self._beneath(where, name)
        if path.suffix.lower() in (*YAML, *ROBOTS):
            self.file(path)

    def _beneath(self, where: Path, name: str) -> Path:
        if "\0" in name:
            raise OutsideError("a file name contains the character NUL: remove it")
        if "\\" in name or re.match(r"[A-Za-z]:", name) or name.startswith("~"):
            raise OutsideError(f"`{plain_name(name)}` is not a path below the studio's folder")
        path = where / name
        return path if path.resolve() == self._folder.root else self._folder.beneath(path, name)

    def _robot(self, content: bytes, path: Path) -> None:
        """Check the files that MuJoCo opens for an MJCF file; for a URDF file it opens none."""
        text = content.decode("utf-8", "replace").lstrip("\ufeff")
        if "<mujoco" not in text or "<robot" in text:
            return
        try:
            root = read_robot_file(text, "mujoco", "from_urdf reads <robot>").root
        except DefinitionError as error:
            raise DefinitionError(f"`{plain_name(path.name)}`: {error}") from None
        bases = [path.parent, *self._asset_folders(root, path.parent)]
        for element, name in _attributes(root, FILES_OF_MJCF):
            if ":" in name:
                raise OutsideError(
                    f"`{plain_name(name)}` in `{plain_name(path.name)}` is not a file below the studio's folder"
                )
            for base in bases:
                target = self._beneath(base, name)
                if element in ("include", "model"):
                    self.file(target)

    def _asset_folders(self, root: Any, where: Path) -> Iterator[Path]:
        for _, name in _attributes(root, FOLDERS):
            yield self._beneath(where, name)

    def _meshes(self, path: Path) -> None:
        try:
            content = self._folder.content(self._folder.beneath(path, path.name), path.name, MOST)
            root = read_robot_file(content.decode("utf-8", "replace").lstrip("\ufeff"), "robot", "").root
        except OutsideError:
            raise
        except DefinitionError:
            return
        for _, name in _attributes(root, ("filename",)):
            self._beneath(path.parent, re.sub(r"^(file://|(package|model):///?)", "", name))


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
