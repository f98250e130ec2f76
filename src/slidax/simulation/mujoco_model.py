"""MuJoCo's model of an arm with payload and table, and the model's simulation step by step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from slidax.arms.arm import Payload
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.core.types import State

from .plant import Box, MujocoPlant, Table, box_like, principal


def mujoco() -> Any:
    """Return the `mujoco` package. Raises DefinitionError if it is not installed."""
    try:
        import mujoco as package
    except ImportError:
        raise DefinitionError(
            "a MujocoPlant needs MuJoCo, which is not installed: pip install 'slidax[robots]'"
        ) from None
    return package


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress MuJoCo's warnings on the terminal and in its log file, since the outcome reports the cause."""
    package = mujoco()
    before = package.get_mju_user_warning()
    package.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        package.set_mju_user_warning(before)


INTEGRATORS = {
    "implicitfast": "mjINT_IMPLICITFAST",
    "implicit": "mjINT_IMPLICIT",
    "euler": "mjINT_EULER",
    "rk4": "mjINT_RK4",
}

STIFF = (0.99, 0.99, 1e-3, 0.5, 2.0)
"""MuJoCo's impedance parameters (`solimp`) of rigid constraints. A sticking joint creeps at 1 % of the velocity that
its torque would cause in one step; with MuJoCo's default it would be 10 %."""

CONTACT = 2e-3
"""Time constant of a contact [s], a tenth of MuJoCo's default: a pressed tip sinks in by less than 0.1 mm. MuJoCo
requires at least two of its time steps: steps longer than 1 ms lengthen it."""

LEAST = 1e-12
"""Mass and moments of inertia of a massless link, kg and kg m²: MuJoCo requires positive values for moving bodies."""


class CompiledModel(NamedTuple):
    """A compiled model, and the arm's indices in it.

    - `positions`, `dofs`: indices of the joints among MuJoCo's positions and velocities [n].
    - `tip`: index of the site at the tip.
    - `body`: indices of the first position and velocity of the free body; None without one.
    """

    model: Any
    positions: np.ndarray
    dofs: np.ndarray
    tip: int
    body: tuple[int, int] | None


def build(
    plant: MujocoPlant, robot: Articulated, load: Payload | None, *, free: bool, timestep: float
) -> CompiledModel:
    """Compile MuJoCo's model of an arm and its surroundings.

    - `plant`: options and surroundings.
    - `robot`: the arm with its payload.
    - `load`: payload that gets a box as its shape, which can touch the table; None without one.
    - `free`: True if this payload is released and so not part of the robot's payload.
    - `timestep`: MuJoCo's step [s].

    Raises DefinitionError if MuJoCo rejects the arm.
    """
    mj = mujoco()
    spec = mj.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.compiler.boundmass = spec.compiler.boundinertia = LEAST
    option = spec.option
    option.timestep = timestep
    option.gravity = np.asarray(robot.gravity_vector)
    option.integrator = getattr(mj.mjtIntegrator, INTEGRATORS[plant.integrator])
    option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    # An infinite state must end the run; by default MuJoCo would reset it.
    option.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET
    links, joints = _links(spec, robot, plant, timestep=timestep)
    carrier = links[robot.tip_joint]
    tip = {"pos": np.asarray(robot.tip_translation), "quat": _quaternion(robot.tip_rotation)}
    site = carrier.add_site(name="tip", **tip)
    if plant.surroundings is not None:
        _add_table(spec.worldbody, plant.surroundings, np.asarray(robot.gravity_vector))
    _add_shape(carrier, mj.mjtGeom.mjGEOM_SPHERE, pos=tip["pos"], size=[float(plant.tip_radius), 0.0, 0.0])
    carried, shaped, body = robot.payload, None, None
    if float(carried.mass) > 0:
        # A body without a joint: MuJoCo adds its inertia to the link.
        shaped = carrier.add_body(**tip)
        _with_inertia(shaped, carried.mass, carried.center, carried.inertia)
    if load is not None and free:
        shaped = spec.worldbody.add_body(name="released load")
        _with_inertia(shaped, load.mass, load.center, load.inertia)
        shaped.inertia = _box(load).moments
        # MuJoCo would otherwise move the frame to the centre of mass.
        body = shaped.add_freejoint(align=mj.mjtAlignFree.mjALIGNFREE_FALSE)
    if load is not None:
        _add_box(shaped, load)
    try:
        model = spec.compile()
    except ValueError as error:
        raise DefinitionError(f"MuJoCo rejects {robot.name}: {error}") from error
    return CompiledModel(
        model=model,
        positions=np.array([model.jnt_qposadr[joint.id] for joint in joints]),
        dofs=np.array([model.jnt_dofadr[joint.id] for joint in joints]),
        tip=site.id,
        body=None if body is None else (int(model.jnt_qposadr[body.id]), int(model.jnt_dofadr[body.id])),
    )


def _links(spec: Any, robot: Articulated, plant: MujocoPlant, *, timestep: float) -> tuple[list[Any], list[Any]]:
    """Add the links with their joints; return both in slidax's order, since MuJoCo's differs in branched arms."""
    mj = mujoco()
    links: list[Any] = []
    joints: list[Any] = []
    for i, parent in enumerate(robot.parents):
        link = (links[parent] if parent >= 0 else spec.worldbody).add_body(
            name=robot.link_names[i],
            pos=np.asarray(robot.translations[i]),
            quat=_quaternion(robot.rotations[i]),
        )
        _with_inertia(link, robot.masses[i], robot.centers[i], robot.inertias[i])
        hinge = robot.joint_units[i] == "rad"
        joint = link.add_joint(
            name=robot.joint_names[i],
            type=mj.mjtJoint.mjJNT_HINGE if hinge else mj.mjtJoint.mjJNT_SLIDE,
            axis=[0.0, 0.0, 1.0],
            armature=float(robot.armature[i]),
            frictionloss=float(robot.coulomb[i]) if plant.dry else 0.0,
            # The stiffest friction that the step allows.
            solref_friction=[2.0 * timestep, 1.0],
            solimp_friction=STIFF,
        )
        joint.damping[0] = float(robot.viscous[i])
        lower, upper = float(robot.limits.lower[i]), float(robot.limits.upper[i])
        if plant.stops and (np.isfinite(lower) or np.isfinite(upper)):
            joint.limited = mj.mjtLimited.mjLIMITED_TRUE
            joint.range = np.clip([lower, upper], -1e6, 1e6)
            joint.solref_limit = [CONTACT, 1.0]
            joint.solimp_limit = STIFF
        links.append(link)
        joints.append(joint)
    return links, joints


def _with_inertia(body: Any, mass: Any, center: Any, inertia: Any) -> None:
    moments, axes = principal(np.asarray(inertia))
    body.explicitinertial = True
    body.mass = float(mass)
    body.ipos = np.asarray(center)
    body.iquat = _quaternion(axes)
    body.inertia = moments


def _add_table(world: Any, table: Table, gravity: np.ndarray) -> None:
    size = float(np.linalg.norm(gravity))
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    geom = world.add_geom(name="table", type=mujoco().mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1])
    geom.pos = float(table.height) * up
    geom.alt.zaxis = up
    geom.contype, geom.conaffinity = 1, 0
    # Use the table's parameters for all contacts.
    geom.priority = 1
    geom.friction = [float(table.friction), 0.005, 1e-4]
    geom.solref = [CONTACT, 1.0]
    geom.solimp = STIFF


def _add_box(body: Any, load: Payload) -> None:
    quaternion = _quaternion(principal(np.asarray(load.inertia)).axes)
    kind = mujoco().mjtGeom.mjGEOM_BOX
    _add_shape(body, kind, pos=np.asarray(load.center), size=_box(load).sides, quat=quaternion)


def _box(load: Payload) -> Box:
    return box_like(float(load.mass), principal(np.asarray(load.inertia)).moments)


def _add_shape(body: Any, kind: Any, **where: Any) -> None:
    """Add a shape that touches only the table, since the links of an arm overlap at the joints."""
    body.add_geom(type=kind, contype=0, conaffinity=1, mass=0.0, **where)


def _quaternion(rotation: Any) -> np.ndarray:
    quaternion = np.empty(4)
    mujoco().mju_mat2Quat(quaternion, np.asarray(rotation, float).reshape(9))
    return quaternion


class World:
    """The arm and its surroundings in MuJoCo, with their current state.

    To attach or release a payload, the world switches to another model, in which the payload is part of the last link
    or a separate body. This is exact. MuJoCo's weld constraints could be switched within one model, but they are
    compliant and add six unknown forces to each step.

    - `plant`: the arm, its payload and its surroundings.
    - `timestep`: MuJoCo's step [s].
    - `state`: the arm's state at t = 0.
    """

    def __init__(self, plant: MujocoPlant, timestep: float, state: State) -> None:
        self._mujoco = mujoco()
        self._plant = plant
        self._timestep = timestep
        self.q = np.array(state.q, float)
        self.dq = np.array(state.dq, float)
        self.force = np.zeros_like(self.q)
        load = plant.load
        self._changes: list[float] = []
        if load is not None and float(load.payload.mass) > 0:
            self._changes = [float(load.attached), float(load.released)]
        self._switch_model(0)
        self.advance_to(0.0)

    @property
    def model(self) -> Any:
        """MuJoCo's current model."""
        return self._compiled.model

    @property
    def positions(self) -> np.ndarray:
        """Indices of the joints among MuJoCo's positions [n]."""
        return self._compiled.positions

    @property
    def dofs(self) -> np.ndarray:
        """Indices of the joints among MuJoCo's velocities [n]."""
        return self._compiled.dofs

    @property
    def data(self) -> Any:
        """MuJoCo's state and results, `MjData`, of the current model."""
        return self._data

    @property
    def body(self) -> np.ndarray | None:
        """Position and quaternion of the released payload [7]; None before the release."""
        if self._compiled.body is None:
            return None
        start = self._compiled.body[0]
        return self._data.qpos[start : start + 7].copy()

    def advance_to(self, time: float) -> None:
        """Attach or release the payload if it is due at this time [s]."""
        while self._changes and time >= self._changes[0]:
            self._changes.pop(0)
            self._switch_model(self._phase + 1)

    def step(self, time: float) -> None:
        """Take one step of MuJoCo from this time [s] under `force`, and update `q` and `dq`."""
        self.advance_to(time)
        built = self._compiled
        self._applied[built.dofs] = self.force
        self._mujoco.mj_step(built.model, self._data)
        # With the mode "raise", NumPy would buffer the output.
        self._positions.take(built.positions, out=self.q, mode="clip")
        self._velocities.take(built.dofs, out=self.dq, mode="clip")

    def _switch_model(self, phase: int) -> None:
        """Switch to the model without the payload (0), with it attached (1), or with it released (2)."""
        plant, load = self._plant, self._plant.load
        robot = plant.robot
        assert isinstance(robot, Articulated)
        if load is not None and phase == 1:
            carried = load.on(robot, load.attached)
            assert isinstance(carried, Articulated)
            robot = carried
        shaped = None if load is None or phase == 0 else load.payload
        built = build(plant, robot, shaped, free=phase == 2, timestep=self._timestep)
        data = self._mujoco.MjData(built.model)
        data.qpos[built.positions] = self.q
        data.qvel[built.dofs] = self.dq
        if built.body is not None:
            qpos, qvel = built.body
            data.qpos[qpos : qpos + 7], data.qvel[qvel : qvel + 6] = self._tip()
        self._phase, self._compiled, self._data = phase, built, data
        # Views of MuJoCo's memory, since each access to the attributes costs as much as a copy.
        self._positions, self._velocities, self._applied = data.qpos, data.qvel, data.qfrc_applied

    def _tip(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the tip's pose [7] and velocity [6] in MuJoCo's form for a free body.

        The linear velocity is in the base frame, the angular velocity in the tip's frame.
        """
        mj, model, data, tip = self._mujoco, self._compiled.model, self._data, self._compiled.tip
        mj.mj_forward(model, data)
        pose, motion = np.empty(7), np.empty(6)
        pose[:3] = data.site_xpos[tip]
        mj.mju_mat2Quat(pose[3:], data.site_xmat[tip])
        mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_SITE, tip, motion, 0)
        angular = data.site_xmat[tip].reshape(3, 3).T @ motion[:3]
        return pose, np.concatenate([motion[3:], angular])
