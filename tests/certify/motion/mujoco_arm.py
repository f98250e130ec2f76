"""An arm of a URDF file in MuJoCo, with friction and a payload unknown to slidax."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certify.motion.path_cells import Pieces

mujoco = pytest.importorskip("mujoco")

SUBSTEPS = 5
RESOLUTION = 1e-5
"""Encoder resolution, rad."""


class MujocoArm:
    """The simulated arm with sensors and drives at 1 kHz."""

    def __init__(self, file: Path, last: str, *, payload: float, coulomb: float, viscous: float, rotor: float) -> None:
        spec = mujoco.MjSpec.from_string(file.read_text())
        # A ball in the hand.
        held = spec.body(last).add_body(pos=[0.02, 0.0, 0.08])
        held.mass, held.inertia, held.explicitinertial = payload, [0.003 * payload] * 3, True
        self.model = spec.compile()
        self.period = 1e-3
        self.model.opt.timestep = self.period / SUBSTEPS
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.model.jnt_limited[:] = 0
        self.model.dof_armature[:], self.model.dof_damping[:] = rotor, viscous
        self.model.dof_frictionloss[:] = coulomb
        self.data = mujoco.MjData(self.model)

    def reset(self, q: np.ndarray) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = q

    @property
    def q(self) -> np.ndarray:
        return self.data.qpos.copy()

    def move(self, tau: np.ndarray) -> None:
        """Hold a torque for one period."""
        self.data.qfrc_applied[:] = tau
        mujoco.mj_step(self.model, self.data, SUBSTEPS)

    def log(self, motion: Any, pd: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
        """Time, positions and torques [N 1+2n] under a PD law along a motion, as the arm's sensors show them."""
        times = np.arange(0.0, float(motion.times[-1]), self.period)
        q_d, dq_d, *_ = Pieces.of(motion).at(times)
        self.reset(q_d[0])
        rows = []
        for t, q, dq in zip(times, q_d, dq_d, strict=True):
            mujoco.mj_forward(self.model, self.data)
            tau = self.data.qfrc_bias + pd[0] * (q - self.q) + pd[1] * (dq - self.data.qvel)
            rows.append(np.concatenate([[t], np.round(self.q / RESOLUTION) * RESOLUTION, tau]))
            self.move(tau)
        values, n = np.array(rows), len(self.q)
        noise = 0.01 * np.sqrt(np.mean(values[:, 1 + n :] ** 2, axis=0))
        values[:, 1 + n :] += noise * rng.standard_normal((len(values), n))
        return values


class ExportedLaw:
    """The law that `slidax export c` writes, called through its C interface."""

    def __init__(self, library: Any, joints: int) -> None:
        self.library, self.joints = library, joints
        self.state = ctypes.create_string_buffer(1 << 16)
        self.parameters = ctypes.create_string_buffer(1 << 16)
        library.slidax_law_parameters_default(self.parameters)
        library.slidax_law_step.restype = ctypes.c_uint32

    def reset(self) -> None:
        self.library.slidax_law_reset(self.state)

    def step(self, t: float, q: np.ndarray, now: np.ndarray, following: np.ndarray) -> tuple[np.ndarray, int]:
        """The torque and the status.

        - `now`, `following`: the reference's position and velocity [2 n], at this sample and the next one.
        """
        n = self.joints
        nothing = np.zeros(n)
        measured = np.concatenate([[t], q, nothing])
        reference = np.concatenate([now[0], now[1], nothing, following[0], following[1], nothing])
        command = ctypes.create_string_buffer(1 << 12)
        pointer = ctypes.POINTER(ctypes.c_double)
        status = self.library.slidax_law_step(
            measured.ctypes.data_as(pointer),
            reference.ctypes.data_as(pointer),
            self.state,
            self.parameters,
            command,
        )
        return np.frombuffer(command, float, n).copy(), int(status)
