"""The visible content of a run, independent of the renderer."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import equinox as eqx
import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot, Articulated, Coupled
from slidax.simulation import Run, Table

from .load import PayloadMotion, payload_motion
from .motion import SampledRun, sample_run
from .needed import require_packages
from .skeleton import Skeleton, skeleton_of
from .solid import Solid, merged
from .stage import Stage, make_stage


@dataclass(frozen=True)
class Drawing:
    """A run with shapes and poses, ready for a renderer.

    - `skeleton`, `motion`, `stage`: joint frames, poses over time, and the surroundings.
    - `solids`: shapes of the arm; the stand belongs to body 0.
    - `payload`, `table`: None if there is none.
    - `torque_limits`: largest torque of each joint [n], N m or N; infinite if unlimited.
    """

    run: Run
    skeleton: Skeleton
    motion: SampledRun
    stage: Stage
    solids: list[Solid]
    payload: PayloadMotion | None
    table: Solid | None
    torque_limits: np.ndarray
    title: str


def draw(
    run: Run,
    plant: eqx.Module,
    *,
    rate: float,
    most: int,
    title: str = "",
    urdf: str | Path | None = None,
    plain: bool = False,
) -> Drawing:
    """Prepare a run for `show` and `record`.

    - `run`, `plant`, `title`, `urdf`, `plain`: as for `show`.
    - `rate`, `most`: frames per second of the run, > 0, and frames at most.

    Raises DefinitionError if the run has no log, the robot is unknown, or a package is missing.
    """
    require_packages("a picture of an arm", "trimesh")
    from .shapes import plain_shapes, slab, stand, tip_axes

    robot = getattr(plant, "robot", plant)
    if not isinstance(robot, AbstractRobot):
        raise DefinitionError(f"`plant` must be a plant or a robot; got a `{type(plant).__name__}`")
    skeleton = skeleton_of(robot)
    motion = sample_run(run, skeleton, rate, most)
    payload = payload_motion(run, plant, skeleton, motion)
    table = getattr(plant, "surroundings", None)
    stage = make_stage(skeleton, motion, payload, float(table.height) if isinstance(table, Table) else None)
    meshes = _meshes(robot, skeleton, urdf, plain)
    arm = plain_shapes(skeleton, motion.travel, stage.size) if meshes is None else meshes
    solids = merged([*arm, *tip_axes(skeleton), *stand(skeleton, stage, foot=meshes is None)])
    return Drawing(run, skeleton, motion, stage, solids, payload, slab(stage), _torque_limits(plant, robot), title)


def _meshes(robot: AbstractRobot, skeleton: Skeleton, urdf: str | Path | None, plain: bool) -> list[Solid] | None:
    """The manufacturer's meshes of the arm; None if there are none."""
    if plain:
        if urdf is not None:
            raise DefinitionError("`plain` draws plain shapes and `urdf` draws meshes: give only one of them")
        return None
    if urdf is not None:
        require_packages("an arm from its URDF", "collada")
    elif not isinstance(robot, Articulated) or find_spec("collada") is None:
        return None
    from .meshes import find_urdf, mesh_solids

    path = find_urdf(skeleton) if urdf is None else Path(urdf)
    return None if path is None else mesh_solids(skeleton, path, tools=urdf is not None) or None


def _torque_limits(plant: eqx.Module, robot: AbstractRobot) -> np.ndarray:
    """The smaller of the limits of the drive and of the data sheet."""
    limits = np.full(robot.joints, np.inf)
    if isinstance(robot, Articulated | Coupled):
        limits = np.minimum(limits, np.asarray(robot.limits.torque))
    actuator = getattr(plant, "actuator", None)
    return limits if actuator is None else np.minimum(limits, np.asarray(actuator.limits.torque))
