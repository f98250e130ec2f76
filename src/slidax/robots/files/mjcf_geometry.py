"""Shapes of an MJCF file: most do not influence the motion and need not be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .loader import mujoco
from .meshes import WITHOUT, require_mesh

WEIGHS = "the body's inertia comes from it, so give the body an <inertial>"


def drop_what_has_no_weight(spec: Any, folder: Path, meshes: bool, attached: bool) -> None:
    """Replace shapes from files by a small ball, except those that define a body's inertia.

    - `meshes`: True if the dropped meshes must exist as well.
    - `attached`: True if parts come from other files. Only MuJoCo then knows the folders of meshes.

    Raises DefinitionError, naming the body, if a mesh is missing.
    """
    files = {mesh.name: mesh for mesh in spec.meshes}
    needed: set[str] = set()
    for body in spec.bodies:
        weighs = body is not spec.worldbody and by_shape(body)
        for geom in body.geoms:
            mesh = files.get(geom.meshname)
            if mesh is not None and mesh.file and (weighs or meshes) and not attached:
                file = Path(mesh.file).name if spec.strippath else mesh.file
                at = folder / mesh.compiler.meshdir
                require_mesh(f"body `{body.name}`", file, at, instead=WEIGHS if weighs else WITHOUT)
            if weighs:
                needed.add(geom.meshname)
            elif geom.meshname or geom.hfieldname:
                _make_ball(geom)
            geom.material = ""
        for site in body.sites:
            site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    unused = [mesh for mesh in spec.meshes if mesh.name not in needed]
    for element in (*unused, *spec.skins, *spec.materials, *spec.textures, *spec.hfields):
        spec.delete(element)


def by_shape(body: Any) -> bool:
    """True if a body's inertia comes from its shapes."""
    kinds = mujoco().mjtInertiaFromGeom
    way = body.compiler.inertiafromgeom
    if way == kinds.mjINERTIAFROMGEOM_AUTO:
        return not body.explicitinertial
    return bool(way == kinds.mjINERTIAFROMGEOM_TRUE)


def _make_ball(geom: Any) -> None:
    geom.type, geom.size = mujoco().mjtGeom.mjGEOM_SPHERE, [1e-3, 1e-3, 1e-3]
    geom.meshname, geom.hfieldname = "", ""
