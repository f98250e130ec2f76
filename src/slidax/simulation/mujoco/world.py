"""An arm that MuJoCo moves, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax._types import State
from slidax.robots import Articulated

from ..mujoco_plant import MujocoPlant
from .model import build
from .needed import mujoco


class World:
    """The arm and its surroundings at one time.

    To attach or release a payload, the world changes to another model, in which the payload is part of the last link
    or a body of its own: exact, and as stiff as the link. Weld constraints, which MuJoCo can switch, are springs: they
    transmit the payload only as far as they are stiff, and add six unknown forces to every step.

    - `timestep`: of MuJoCo [s].
    - `state`: of the arm, at t = 0.
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
        self._enter(0)
        self.advance_to(0.0)

    @property
    def model(self) -> Any:
        """MuJoCo's present model."""
        return self._built.model

    @property
    def places(self) -> np.ndarray:
        """Indices of the joints among MuJoCo's positions [n]."""
        return self._built.places

    @property
    def dofs(self) -> np.ndarray:
        """Indices of the joints among MuJoCo's velocities [n]."""
        return self._built.dofs

    @property
    def data(self) -> Any:
        """MuJoCo's data."""
        return self._data

    @property
    def body(self) -> np.ndarray | None:
        """Position and quaternion of the released payload [7]; None before the release."""
        if self._built.body is None:
            return None
        at = self._built.body[0]
        return self._data.qpos[at : at + 7].copy()

    def advance_to(self, time: float) -> None:
        """Attach or release the payload if that is due at this time [s]."""
        while self._changes and time >= self._changes[0]:
            self._changes.pop(0)
            self._enter(self._phase + 1)

    def step(self, time: float) -> None:
        """Take one step of MuJoCo from this time [s] under `force`, and update `q` and `dq`."""
        self.advance_to(time)
        built = self._built
        self._applied[built.dofs] = self.force
        self._mujoco.mj_step(built.model, self._data)
        # The mode "raise" would need a copy.
        self._positions.take(built.places, out=self.q, mode="clip")
        self._velocities.take(built.dofs, out=self.dq, mode="clip")

    def _enter(self, phase: int) -> None:
        """Change to the model without the payload (0), with it attached (1), or with it released (2)."""
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
        data.qpos[built.places] = self.q
        data.qvel[built.dofs] = self.dq
        if built.body is not None:
            at, by = built.body
            data.qpos[at : at + 7], data.qvel[by : by + 6] = self._tip()
        self._phase, self._built, self._data = phase, built, data
        # Views of MuJoCo's memory: each access to the attributes costs as much as a copy.
        self._positions, self._velocities, self._applied = data.qpos, data.qvel, data.qfrc_applied

    def _tip(self) -> tuple[np.ndarray, np.ndarray]:
        """Pose and velocity of the tip, as of MuJoCo's free bodies: linear in the base frame, angular in its own."""
        mj, model, data, tip = self._mujoco, self._built.model, self._data, self._built.tip
        mj.mj_forward(model, data)
        pose, motion = np.empty(7), np.empty(6)
        pose[:3] = data.site_xpos[tip]
        mj.mju_mat2Quat(pose[3:], data.site_xmat[tip])
        mj.mj_objectVelocity(model, data, mj.mjtObj.mjOBJ_SITE, tip, motion, 0)
        turning = data.site_xmat[tip].reshape(3, 3).T @ motion[:3]
        return pose, np.concatenate([motion[3:], turning])
