"""Helpers of all readers of robot files: MuJoCo's own reader, assumptions as warnings, and mesh files."""

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
    """Return the package; raise DefinitionError, with the way to install it, if it is missing."""
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
    # Its errors are of several kinds, and what they are is not documented.
    except Exception as error:
        raise DefinitionError(f"MuJoCo does not read the robot file: {_one_line(error)}") from error
    finally:
        library.set_mju_user_warning(before)


def _one_line(error: Exception) -> str:
    """The message without MuJoCo's word "Error" and without line ends."""
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
"""Owners that a warning lists by name."""


class Notes:
    """Assumptions of one reading; the same assumption for several links or joints is one warning, which lists them."""

    def __init__(self) -> None:
        self._owners: dict[tuple[str, str], list[str]] = {}

    def add(self, text: str, owner: str = "") -> None:
        """Note an assumption.

        - `text`: a sentence without its period, and the remedy; `{}` stands for the owners.
        - `owner`: the link or joint, such as "link `forearm`".
        """
        before, _, after = text.partition("{}")
        owners = self._owners.setdefault((before, after), [])
        if owner and owner not in owners:
            owners.append(owner)

    @property
    def sentences(self) -> list[str]:
        """The assumptions in their order."""
        return [f"{before}{_listed(owners)}{after}" for (before, after), owners in self._owners.items()]

    def explain(self, error: DefinitionError) -> DefinitionError:
        """Return the error with the notes about links or joints that it names, or with all if it names none."""
        named = set(re.findall(r"`[^`]*`", error.message))
        hints = [
            f"{before}{_listed(owners)}{after}"
            for (before, after), owners in self._owners.items()
            if not named or named & set(re.findall(r"`[^`]*`", " ".join(owners)))
        ]
        told = error.message + "".join(f"; note that {hint}" for hint in hints)
        return DefinitionError(told, where=error.where).offering(error.setting)

    def warn(self, source: str, stacklevel: int) -> None:
        """Raise one `DefinitionWarning` for each assumption.

        - `source`: path of the file, or the robot's name.
        - `stacklevel`: of `warnings.warn`, relative to the caller.
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

WITHOUT = "meshes=False goes without meshes"
PACKAGE = re.compile(r"(?:package|model):///?([^/]+)/(.+)")


def require_mesh(owner: str, name: str, folder: Path, packages: Packages = (), instead: str = WITHOUT) -> None:
    """Raise DefinitionError, with the searched places, if a mesh file does not exist.

    - `owner`: its owner, for the message: "link `forearm`".
    - `name`: path or address, as the robot file has it.
    - `folder`: of the robot file.
    - `packages`: folders of packages by name, or folders that contain packages.
    - `instead`: the alternative, for the message.
    """
    places = mesh_places(name, folder, packages)
    if any(place.is_file() for place in places):
        return
    looked = ", ".join(str(place) for place in places) or "nowhere, as it is not the address of a file"
    package = PACKAGE.match(name)
    remedy = f"packages={{'{package[1]}': FOLDER}} says where the package is, or " if package else ""
    raise DefinitionError(f"the mesh `{name}` of {owner} is not there; looked for {looked}; {remedy}{instead}")


def mesh_places(name: str, folder: Path, packages: Packages = ()) -> list[Path]:
    """Return the possible places of a mesh, the likeliest first; arguments as in `require_mesh`."""
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
        in_packages = [Path(place) / package / rest for place in packages]
    # A description package mostly holds the robot file itself, or stands beside the one that does.
    around = [above / rest for above in (folder, *folder.parents) if above.name == package]
    siblings = [above / package / rest for above in (folder, *folder.parents) if (above / package).is_dir()]
    return [*in_packages, *around, *siblings] or [folder / package / rest]
