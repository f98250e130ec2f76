"""Dynamics of an arm in random states by MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.peers.motion import Motion, States

mujoco = pytest.importorskip("mujoco")


def by_mujoco(
    model: Any, tip: str, joint_names: tuple[str, ...], states: States, locked: dict[str, float] | None = None
) -> Motion:
    """Dynamics by MuJoCo, without friction and without stops."""
    model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    at = [int(model.joint(name).dofadr[0]) for name in joint_names]
    full, rows = np.zeros((model.nv, model.nv)), []
    for name, position in (locked or {}).items():
        data.joint(name).qpos = position
    place = data.site(tip) if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip) >= 0 else data.body(tip)
    for q, dq, tau in zip(*states, strict=True):
        data.qpos[at], data.qvel[at], data.qfrc_applied[at] = q, 0.0, tau
        mujoco.mj_forward(model, data)
        gravity = data.qfrc_bias[at].copy()
        data.qvel[at] = dq
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        mass, bias = full[np.ix_(at, at)], data.qfrc_bias[at].copy()
        # MuJoCo has no constraint forces for locked joints here, so their rows are left out.
        acceleration = np.linalg.solve(mass, tau - bias) if locked else data.qacc[at].copy()
        rows.append((mass, bias, gravity, acceleration, place.xpos.copy(), place.xmat.reshape(3, 3).copy()))
    return Motion(*(np.stack(part) for part in zip(*rows, strict=True)))
