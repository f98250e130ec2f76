"""Places of mesh files; the files are not read."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from slidax._errors import DefinitionError

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
