"""All that is to be seen of a run, before anything draws it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot, Articulated, Coupled
from slidax.simulation import Run, Table

from .load import MovedLoad, load_of
from .motion import Motion, motion
from .needed import require_packages
from .skeleton import Skeleton, skeleton_of
from .solid import Solid, merged
from .stage import Stage, stage


@dataclass(frozen=True)
class Drawing:
    """A run, ready to be drawn.

    - `run`: it.
    - `skeleton`, `motion`, `stage`: the joints, where they are at each time, and the room.
    - `solids`: of the arm; the stand is body 0's.
    - `load`: what the tip carries; None for nothing.
    - `table`: in the room; None if there is none.
    - `torque_limits`: largest torque of each joint [n], N m or N; infinite for none.
    - `title`: what to call it.
    """

    run: Run
    skeleton: Skeleton
    motion: Motion
    stage: Stage
    solids: list[Solid]
    load: MovedLoad | None
    table: Solid | None
    torque_limits: np.ndarray
    title: str


def drawing(
    run: Run,
    plant: eqx.Module,
    *,
    rate: float,
    most: int,
    title: str = "",
    urdf: str | Path | None = None,
    plain: bool = False,
) -> Drawing:
    """What `show` and `record` draw.

    - `run`, `plant`, `title`, `urdf`, `plain`: as there.
    - `rate`, `most`: frames per second of the run, > 0, and of the whole run.

    Raises DefinitionError if the run has no log, the robot is unknown, or a package is missing.
    """
    require_packages("a picture of an arm", "trimesh")
    from .shapes import plain_shapes, slab, stand, tip_axes

    robot = getattr(plant, "robot", plant)
    if not isinstance(robot, AbstractRobot):
        raise DefinitionError(f"a plant or a robot is needed; got a `{type(plant).__name__}`")
    bones = skeleton_of(robot)
    film = motion(run, bones, rate, most)
    load = load_of(run, plant, bones, film)
    table = getattr(plant, "surroundings", None)
    room = stage(bones, film, load, float(table.height) if isinstance(table, Table) else None)
    meshes = _meshes(robot, bones, urdf, plain)
    arm = plain_shapes(bones, film.travel, room.size) if meshes is None else meshes
    solids = [*arm, *tip_axes(bones), *stand(bones, room, foot=meshes is None)]
    return Drawing(run, bones, film, room, merged(solids), load, slab(room), _torque_limits(plant, robot), title)


def _meshes(robot: AbstractRobot, skeleton: Skeleton, urdf: str | Path | None, plain: bool) -> list[Solid] | None:
    """The arm as its maker drew it; None where there is no such drawing, or nothing of it is there."""
    if plain:
        if urdf is not None:
            raise DefinitionError("`plain` asks for plain shapes, and `urdf` for meshes; give one of them")
        return None
    if urdf is not None:
        require_packages("an arm from its URDF", "collada")
    elif not isinstance(robot, Articulated) or not _have("collada"):
        return None
    from .meshes import find_urdf, mesh_solids

    if urdf is not None:
        return mesh_solids(skeleton, Path(urdf), tools=True) or None
    found = find_urdf(skeleton)
    return None if found is None else mesh_solids(skeleton, found, tools=False) or None


def _have(*packages: str) -> bool:
    try:
        require_packages("", *packages)
    except DefinitionError:
        return False
    return True


def _torque_limits(plant: eqx.Module, robot: AbstractRobot) -> np.ndarray:
    """Of the drive where there is one, and of the data sheet."""
    limits = np.full(robot.joints, np.inf)
    if isinstance(robot, Articulated | Coupled):
        limits = np.minimum(limits, np.asarray(robot.limits.torque))
    actuator = getattr(plant, "actuator", None)
    return limits if actuator is None else np.minimum(limits, np.asarray(actuator.limits.torque))
