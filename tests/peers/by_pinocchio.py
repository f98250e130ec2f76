"""Dynamics of an arm in random states by Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.peers.motion import Motion, States

pinocchio = pytest.importorskip("pinocchio")


def position(model: Any, joint_names: Any, q: np.ndarray) -> np.ndarray:
    """Pinocchio's position vector, with cosine and sine for a continuous joint."""
    place = pinocchio.neutral(model)
    for name, angle in zip(joint_names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        place[joint.idx_q : joint.idx_q + joint.nq] = angle if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
    return place


def by_pinocchio(model: Any, tip: str, joint_names: tuple[str, ...], states: States) -> Motion:
    """Dynamics by Pinocchio, without friction."""
    model.damping = np.zeros(model.nv)
    data = model.createData()
    at = [model.joints[model.getJointId(name)].idx_v for name in joint_names]
    assert sorted(at) == list(range(model.nv))
    body = model.getFrameId(tip, pinocchio.BODY)
    rows = []
    for q, dq, tau in zip(*states, strict=True):
        place, velocity, torque = position(model, joint_names, q), np.zeros(model.nv), np.zeros(model.nv)
        velocity[at], torque[at] = dq, tau
        bias = np.array(pinocchio.nle(model, data, place, velocity))
        gravity = np.array(pinocchio.computeGeneralizedGravity(model, data, place))
        acceleration = np.array(pinocchio.aba(model, data, place, velocity, torque))
        mass = np.array(pinocchio.crba(model, data, place))
        pinocchio.framesForwardKinematics(model, data, place)
        frame = data.oMf[body]
        tip_frame = frame.translation.copy(), frame.rotation.copy()
        rows.append((mass[np.ix_(at, at)], bias[at], gravity[at], acceleration[at], *tip_frame))
    return Motion(*(np.stack(part) for part in zip(*rows, strict=True)))


def held(model: Any, positions: dict[str, float]) -> Any:
    """The model with some joints locked and their links fused to their parents."""
    if not positions:
        return model
    still = pinocchio.neutral(model)
    for name, position in positions.items():
        still[model.joints[model.getJointId(name)].idx_q] = position
    return pinocchio.buildReducedModel(model, [model.getJointId(name) for name in positions], still)
