"""Helpers for all readers of robot files: MuJoCo's reader, warnings about assumptions, and mesh files."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, DefinitionWarning


def mujoco() -> Any:
    """Return the `mujoco` package; raise DefinitionError, with the command to install it, if it is missing."""
    try:
        import mujoco
    except ImportError as error:
        raise DefinitionError("MuJoCo, which reads robot files, is needed: pip install 'slidax[robots]'") from error
    return mujoco


@contextmanager
def reading() -> Iterator[list[str]]:
    """Convert MuJoCo's errors into DefinitionError, and collect its warnings in the yielded list.

    By default MuJoCo prints warnings and writes a log into the working directory.
    """
    library = mujoco()
    messages: list[str] = []
    before = library.get_mju_user_warning()
    try:
        library.set_mju_user_warning(messages.append)
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield messages
        messages.extend(str(warning.message) for warning in raised)
    except DefinitionError:
        raise
    # MuJoCo raises errors of several undocumented types.
    except Exception as error:
        raise DefinitionError(f"MuJoCo does not read the robot file: {_one_line(error)}") from error
    finally:
        library.set_mju_user_warning(before)


def _one_line(error: Exception) -> str:
    """Return MuJoCo's message on one line, without the word "Error"."""
    lines = [line.strip() for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line).removeprefix("Error: ").removeprefix("XML Error: ")


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrix [3 3] of a quaternion, scalar first [4]."""
    matrix = np.zeros(9)
    mujoco().mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Return the rotation matrix [3 3] about a unit axis [3] by an angle [rad]."""
    quaternion = np.zeros(4)
    mujoco().mju_axisAngle2Quat(quaternion, axis, angle)
    return matrix_of(quaternion)


MOST = 4
"""Most links or joints that a warning lists by name."""


class Notes:
    """Assumptions while reading a file; those that are equal for several links or joints share a warning."""

    def __init__(self) -> None:
        self._owners: dict[tuple[str, str], list[str]] = {}

    def add(self, text: str, owner: str = "") -> None:
        """Note an assumption.

        - `text`: the assumption and the remedy, without a period; `{}` is replaced by the owners.
        - `owner`: the link or joint, such as "link `forearm`".
        """
        before, _, after = text.partition("{}")
        owners = self._owners.setdefault((before, after), [])
        if owner and owner not in owners:
            owners.append(owner)

    @property
    def sentences(self) -> list[str]:
        """The assumptions in the order of their addition."""
        return [f"{before}{_listed(owners)}{after}" for (before, after), owners in self._owners.items()]

    def explain(self, error: DefinitionError) -> DefinitionError:
        """Return the error with notes added to its message.

        They are the notes about links and joints that the message names, or all notes if it names none.
        """
        named = set(re.findall(r"`[^`]*`", error.message))
        hints = [
            f"{before}{_listed(owners)}{after}"
            for (before, after), owners in self._owners.items()
            if not named or named & set(re.findall(r"`[^`]*`", " ".join(owners)))
        ]
        message = error.message + "".join(f"; note that {hint}" for hint in hints)
        return DefinitionError(message, where=error.where).offering(error.setting)

    def warn(self, source: str, stacklevel: int) -> None:
        """Issue one `DefinitionWarning` for each assumption.

        - `source`: path of the file, or the robot's name.
        - `stacklevel`: stack level for `warnings.warn`, relative to the caller.
        """
        for sentence in self.sentences:
            warnings.warn(f"{source}: {sentence}", DefinitionWarning, stacklevel=stacklevel + 1)


def _listed(owners: list[str]) -> str:
    if len(owners) <= 1:
        return "".join(owners)
    shown = owners[:MOST]
    rest = len(owners) - len(shown)
    if rest:
        return f"{', '.join(shown)} and {rest} more"
    return f"{', '.join(shown[:-1])} and {shown[-1]}"


Packages = Mapping[str, str | Path] | Sequence[str | Path]

WITHOUT = "meshes=False needs no mesh files"
PACKAGE = re.compile(r"(?:package|model):///?([^/]+)/(.+)")


def require_mesh(owner: str, name: str, folder: Path, packages: Packages = (), instead: str = WITHOUT) -> None:
    """Raise DefinitionError, with the searched paths, if a mesh file does not exist.

    - `owner`: the link or body with the mesh, for the message: "link `forearm`".
    - `name`: path or URI in the robot file.
    - `folder`: folder of the robot file.
    - `packages`: folders of packages by name, or folders that contain packages.
    - `instead`: the alternative, for the message.
    """
    paths = mesh_paths(name, folder, packages)
    if any(path.is_file() for path in paths):
        return
    looked = ", ".join(str(path) for path in paths) or "nowhere, as it is not the address of a file"
    package = PACKAGE.match(name)
    remedy = f"packages={{'{package[1]}': FOLDER}} says where the package is, or " if package else ""
    raise DefinitionError(f"the mesh `{name}` of {owner} does not exist; searched {looked}; {remedy}{instead}")


def mesh_paths(name: str, folder: Path, packages: Packages = ()) -> list[Path]:
    """Return the possible paths of a mesh, the most likely first; arguments as in `require_mesh`."""
    package = PACKAGE.match(name)
    if package:
        return _in_package(package[1], package[2], folder, packages)
    if name.startswith("file://"):
        return [Path(name.removeprefix("file://"))]
    return [] if "://" in name else [folder / name]


def _in_package(package: str, rest: str, folder: Path, packages: Packages) -> list[Path]:
    if isinstance(packages, Mapping):
        if package in packages:
            return [Path(packages[package]) / rest]
        in_packages = []
    else:
        in_packages = [Path(folder_of_packages) / package / rest for folder_of_packages in packages]
    # A description package usually contains the robot file, or is a sibling of the package that does.
    around = [above / rest for above in (folder, *folder.parents) if above.name == package]
    siblings = [above / package / rest for above in (folder, *folder.parents) if (above / package).is_dir()]
    return [*in_packages, *around, *siblings] or [folder / package / rest]
