"""The visible content of a run, independent of the renderer: poses, payload, stage and camera."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import equinox as eqx
import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.mismatch import TimedPayload
from slidax.core.errors import DefinitionError
from slidax.simulation.plant import FreeBody, Table, box_like, principal
from slidax.simulation.run import Run

from .skeleton import LARGEST, SampledRun, Skeleton, sample_run, skeleton_of
from .solids import LOAD, Solid, merge_solids, turn_up


@dataclass(frozen=True)
class PayloadMotion:
    """Pose of a payload in each frame of a replay. While the tip carries the payload, the payload's frame is the tip's.

    - `solid`: the box of uniform density with the payload's mass and moments of inertia.
    - `rotations`, `positions`: pose of the payload's frame in the base frame [frames 3 3], [frames 3], m.
    - `carried`: True while the tip carries the payload [frames].
    - `visible`: True while the payload's pose is known [frames].
    """

    solid: Solid
    rotations: np.ndarray
    positions: np.ndarray
    carried: np.ndarray
    visible: np.ndarray

    def corners(self, frames: np.ndarray) -> np.ndarray:
        """Return the box's corners in all frames of the mask `frames`, in the base frame [points 3], m."""
        turned = self.solid.vertices @ self.rotations[frames].transpose(0, 2, 1)
        return (turned + self.positions[frames, None]).reshape(-1, 3)


def payload_motion(run: Run, plant: eqx.Module, skeleton: Skeleton, motion: SampledRun) -> PayloadMotion | None:
    """Return the motion of the payload in a `run`; None if the plant has no payload.

    - `plant`: a plant, or only a robot.
    - `skeleton`, `motion`: skeleton and motion of the plant's arm.
    """
    load = getattr(plant, "load", None)
    if not isinstance(load, TimedPayload) or not float(load.payload.mass) > 0:
        return None
    t = motion.t
    rotations = motion.actual.rotations[:, skeleton.tip_joint + 1] @ skeleton.tip_rotation
    positions = motion.actual_tip.copy()
    carried = (t >= float(load.attached)) & (t < float(load.released))
    visible = carried.copy()
    free = t >= float(load.released)
    flight = None if run.load is None else _valid(run.load)
    if flight is not None and free.any():
        rotations[free], positions[free] = _at(t[free], flight)
        visible |= free
    return PayloadMotion(_box(load), rotations, positions, carried, visible)


def _box(load: TimedPayload) -> Solid:
    from .shapes import box

    payload = load.payload
    moments, axes = principal(np.asarray(payload.inertia))
    sides = box_like(float(payload.mass), moments).sides
    return box(2 * sides, LOAD, axes, np.asarray(payload.center))


def _valid(body: FreeBody) -> FreeBody | None:
    """Return the finite samples of a free body; None without any."""
    rotation, position = np.asarray(body.rotation), np.asarray(body.position)
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(rotation).all(axis=(1, 2)) & (np.abs(position) < LARGEST).all(axis=1)
    return FreeBody(np.asarray(body.t)[valid], rotation[valid], position[valid]) if valid.any() else None


def _at(t: np.ndarray, body: FreeBody) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate rotations and positions; they are constant before the first and after the last sample."""
    positions = np.stack([np.interp(t, body.t, column) for column in body.position.T], axis=1)
    if len(body.t) == 1:
        return np.tile(body.rotation, (len(t), 1, 1)), positions
    slerp = Slerp(body.t, Rotation.from_matrix(body.rotation))
    return slerp(np.clip(t, body.t[0], body.t[-1])).as_matrix(), positions


FIELD_OF_VIEW = 0.7
"""Vertical opening angle of the camera [rad]."""

FAR = 2.0
"""The camera does not keep a payload in view that is farther from the base than this multiple of the reach."""


@dataclass(frozen=True)
class SceneStage:
    """The surroundings: z up, the ground at z = 0, or lower if the table would intersect it.

    - `rotation`: axes of the base frame as columns [3 3].
    - `height`: height of the base above the ground, m.
    - `camera`, `target`: positions of the camera and of the point that it looks at [3], m.
    - `wide_camera`, `wide_target`: these positions for a view of both arms side by side [3], m.
    - `shift`: offset of the reference when it is beside the true arm [3], m.
    - `size`: diameter of the visible scene, m.
    - `ground`: height of the ground, m.
    - `table`: lowest and highest corner of the table [2 3], m; None if there is none.
    """

    rotation: np.ndarray
    height: float
    camera: np.ndarray
    target: np.ndarray
    wide_camera: np.ndarray
    wide_target: np.ndarray
    shift: np.ndarray
    size: float
    ground: float = 0.0
    table: np.ndarray | None = None

    @property
    def tile(self) -> float:
        """Side of a ground tile: 1, 2 or 5 times a power of ten, m."""
        decade = 10.0 ** np.floor(np.log10(self.size / 10))
        return float(decade * max(step for step in (1, 2, 5) if step * decade <= self.size / 10))

    @property
    def base(self) -> np.ndarray:
        """Position of the base [3], m."""
        return np.array([0.0, 0.0, self.height])

    def points(self, points: np.ndarray) -> np.ndarray:
        """Return `points` [k 3], m, of the base frame in the frame of the scene."""
        return points @ self.rotation.T + self.base


def make_stage(
    skeleton: Skeleton, motion: SampledRun, payload: PayloadMotion | None = None, table: float | None = None
) -> SceneStage:
    """Return the surroundings for an arm and its `motion`; `table` is the height of a table above the base, m."""
    rotation = turn_up(skeleton.up)
    points = _points(skeleton, motion, payload) @ rotation.T
    thick = 0.05 * skeleton.reach
    lowest = min(float(points[:, 2].min()), np.inf if table is None else table)
    height = 4 * thick - lowest if lowest < -thick else 0.0
    fallen = _fallen(payload, rotation, -height if table is None else table, FAR * skeleton.reach)
    base = np.array([0.0, 0.0, height])
    visible = np.concatenate([points + base, fallen + base, [np.zeros(3), base]])
    slab = None
    if table is not None:
        tips = np.concatenate([motion.actual_tip, motion.desired_tip]) @ rotation.T
        # An arm whose base is on the table stands on it.
        feet = np.array([[-1, -1, 0], [1, 1, 0]]) * 2 * thick if abs(table) < thick else np.zeros((0, 3))
        slab = _slab(np.concatenate([tips, fallen, feet]) + base, table + height, thick)
        visible = np.concatenate([visible, slab])
    low, high = visible.min(axis=0) - thick, visible.max(axis=0) + thick
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    # An arm that moves in one plane is seen from in front of it.
    flat = np.ptp(points[:, 1]) < 1e-6 * skeleton.reach
    look = np.array([0.28, -1.0, 0.22]) if flat else np.array([0.85, -1.0, 0.5])
    look = look / np.linalg.norm(look)
    right = np.array([-look[1], look[0], 0.0]) / np.hypot(look[0], look[1])
    shift = right * (np.ptp(corners @ right) + 0.1 * skeleton.reach)
    camera, target, size = camera_for(corners, look)
    wide_camera, wide_target, _ = camera_for(np.concatenate([corners, corners + shift]), look)
    # Two faces at one height would flicker.
    ground = 0.0 if slab is None else min(0.0, float(slab[0, 2]) - 0.1 * thick)
    return SceneStage(rotation, height, camera, target, wide_camera, wide_target, shift, size, ground, slab)


def _slab(above: np.ndarray, top: float, thick: float) -> np.ndarray:
    """Return the lowest and the highest corner [2 3], m, of a table below the points `above`."""
    low, high = above.min(axis=0) - 2 * thick, above.max(axis=0) + 2 * thick
    low[2], high[2] = top - 0.3 * thick, top
    return np.stack([low, high])


def _fallen(payload: PayloadMotion | None, rotation: np.ndarray, floor: float, far: float) -> np.ndarray:
    """Return the corners of a released payload that are above the floor and near the base [points 3], m."""
    if payload is None:
        return np.zeros((0, 3))
    corners = payload.corners(payload.visible & ~payload.carried) @ rotation.T
    near = np.linalg.norm(corners[:, :2], axis=1) < far
    return corners[near & (corners[:, 2] > floor - 0.1 * far)]


def _points(skeleton: Skeleton, motion: SampledRun, payload: PayloadMotion | None) -> np.ndarray:
    """Return all positions of joints, tips, prismatic joints' ends and carried payload, base frame [points 3], m."""
    points = [motion.actual_tip, motion.desired_tip]
    if payload is not None:
        points.append(payload.corners(payload.carried))
    for poses in (motion.actual, motion.desired):
        points.append(poses.positions.reshape(-1, 3))
        for joint in np.flatnonzero(~np.array(skeleton.revolute)):
            points.append(poses.points(int(joint) + 1, np.array([0, 0, -motion.travel[joint]])))
    return np.concatenate(points)


def camera_for(corners: np.ndarray, look: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return camera position, target and scene diameter that show all `corners` [k 3], m.

    - `look`: unit vector from the target to the camera.
    """
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    offsets = corners - middle
    right = np.array([-look[1], look[0], 0.0]) / np.hypot(look[0], look[1])
    aside, above = np.abs(offsets @ right), np.abs(offsets @ np.cross(look, right))
    away = offsets @ look + np.maximum(above, aside / 1.2) / np.tan(FIELD_OF_VIEW / 2)
    size = 2 * float(np.linalg.norm(offsets, axis=1).max())
    return middle + look * 1.08 * float(away.max()), middle, size


def require_packages(purpose: str, *packages: str, extra: str = "view") -> None:
    """Raise DefinitionError with the remedy if one of the packages is not installed.

    - `purpose`: subject of the message, such as "a replay in the browser".
    - `packages`: import names.
    - `extra`: the extra of slidax that installs them.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise DefinitionError(f"{purpose} needs {' and '.join(missing)}: pip install 'slidax[{extra}]'")


@dataclass(frozen=True)
class Drawing:
    """A run with shapes and poses, ready for a renderer.

    - `skeleton`, `motion`, `stage`: joint frames, poses over time, and the surroundings.
    - `solids`: shapes of the arm; the stand belongs to body 0.
    - `payload`, `table`: motion of the payload, and solid of the table; None if the plant has none.
    - `torque_limits`: largest torque of each joint [n], N m or N; infinite if unlimited.
    """

    run: Run
    skeleton: Skeleton
    motion: SampledRun
    stage: SceneStage
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
    - `rate`, `most`: frames per second of simulated time, > 0, and largest number of frames.

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
    solids = merge_solids([*arm, *tip_axes(skeleton), *stand(skeleton, stage, foot=meshes is None)])
    return Drawing(run, skeleton, motion, stage, solids, payload, slab(stage), _torque_limits(plant, robot), title)


def _meshes(robot: AbstractRobot, skeleton: Skeleton, urdf: str | Path | None, plain: bool) -> list[Solid] | None:
    """Return the manufacturer's meshes of the arm; None for plain shapes."""
    if plain:
        if urdf is not None:
            raise DefinitionError("`plain` draws plain shapes and `urdf` draws meshes: give only one of them")
        return None
    if urdf is not None:
        require_packages("an arm from its URDF", "collada")
    elif not isinstance(robot, Articulated) or find_spec("collada") is None:
        return None
    from .shapes import find_urdf, mesh_solids

    path = find_urdf(skeleton) if urdf is None else Path(urdf)
    return None if path is None else mesh_solids(skeleton, path, tools=urdf is not None) or None


def _torque_limits(plant: eqx.Module, robot: AbstractRobot) -> np.ndarray:
    """Return each joint's torque limit: the smaller one of the drive's and the robot's."""
    limits = np.full(robot.joints, np.inf)
    if isinstance(robot, Articulated | Coupled):
        limits = np.minimum(limits, np.asarray(robot.limits.torque))
    actuator = getattr(plant, "actuator", None)
    return limits if actuator is None else np.minimum(limits, np.asarray(actuator.limits.torque))
