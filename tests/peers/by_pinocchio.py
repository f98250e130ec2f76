"""How an arm moves in random states, as Pinocchio computes it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.peers.motion import Motion, States

pinocchio = pytest.importorskip("pinocchio")


def by_pinocchio(model: Any, tip: str, joint_names: tuple[str, ...], states: States) -> Motion:
    """Without friction."""
    model.damping = np.zeros(model.nv)
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in joint_names]
    at = [joint.idx_v for joint in joints]
    assert sorted(at) == list(range(model.nv))
    body = model.getFrameId(tip, pinocchio.BODY)
    found = []
    for q, dq, tau in zip(*states, strict=True):
        place, velocity, torque = pinocchio.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for joint, position in zip(joints, q, strict=True):
            # Of a joint without end Pinocchio has the cosine and the sine.
            place[joint.idx_q : joint.idx_q + joint.nq] = (
                position if joint.nq == 1 else [np.cos(position), np.sin(position)]
            )
        velocity[at], torque[at] = dq, tau
        bias = np.array(pinocchio.nle(model, data, place, velocity))
        gravity = np.array(pinocchio.computeGeneralizedGravity(model, data, place))
        acceleration = np.array(pinocchio.aba(model, data, place, velocity, torque))
        mass = np.array(pinocchio.crba(model, data, place))
        pinocchio.framesForwardKinematics(model, data, place)
        frame = data.oMf[body]
        found.append(
            (
                mass[np.ix_(at, at)],
                bias[at],
                gravity[at],
                acceleration[at],
                frame.translation.copy(),
                frame.rotation.copy(),
            )
        )
    return Motion(*(np.stack(part) for part in zip(*found, strict=True)))


def held(model: Any, positions: dict[str, float]) -> Any:
    """The model with some joints held, their links joined to what carries them."""
    if not positions:
        return model
    still = pinocchio.neutral(model)
    for name, position in positions.items():
        still[model.joints[model.getJointId(name)].idx_q] = position
    return pinocchio.buildReducedModel(model, [model.getJointId(name) for name in positions], still)
