"""Arms as point masses against the arms' own equations."""

from typing import Any

import jax
import numpy as np
import pytest

import slidax.arms as arms
from slidax.certify.motion.body_points import BodyPoints, PointMotion, frame_motion
from slidax.certify.motion.parameter_region import BodyBand
from slidax.certify.motion.path import Path

from .cases import panda, still, ur5e

ARMS = {"panda": panda, "ur5e": ur5e, "gen3": arms.gen3, "xarm7": arms.xarm7}


def motion(arm: Any, count: int = 20) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.normal(size=(count, arm.joints)) for _ in range(4)]


def at(bodies: BodyPoints, parts: list[np.ndarray]) -> PointMotion:
    return frame_motion(bodies, *parts).of(bodies.points)


@pytest.mark.parametrize("name", ARMS)
def test_dynamics_from_body_points_agree_with_the_arm_model(name: str) -> None:
    arm = ARMS[name]()
    bodies, (q, dq, ddq, dddq) = BodyPoints.of(arm), motion(arm)
    points = at(bodies, [q, dq, ddq, dddq])
    y, y1, _ = points.columns
    transposed = y.swapaxes(1, 2)
    mass = transposed @ y + np.diag(bodies.rotors)
    np.testing.assert_allclose(mass, jax.vmap(arm.mass)(q), atol=1e-12)
    np.testing.assert_allclose(transposed @ y1, jax.vmap(arm.coriolis)(q, dq), atol=1e-12)
    torque = (transposed @ points.acceleration[..., None])[..., 0] + bodies.rotors * ddq
    own = jax.vmap(lambda q, dq, ddq: arm.mass(q) @ ddq + arm.bias(q, dq))(q, dq, ddq)
    np.testing.assert_allclose(torque, own, atol=1e-11)


def test_position_derivative_of_the_torque_from_body_points_agrees_with_jax() -> None:
    arm = panda()
    q, dq, ddq, dddq = motion(arm, 5)
    bodies = BodyPoints.of(arm)
    own = Path.of(bodies, BodyBand(0.0, 0.0).region(bodies), still(q, dq, ddq, dddq)).stiffness
    torque = jax.jacfwd(lambda q, dq, ddq: arm.mass(q) @ ddq + arm.bias(q, dq))
    np.testing.assert_allclose(own, jax.vmap(torque)(q, dq, ddq), atol=1e-11)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_time_derivatives_of_body_points_agree_with_finite_differences(name: str) -> None:
    arm = ARMS[name]()
    bodies, (q, dq, ddq, dddq) = BodyPoints.of(arm), motion(arm)
    points = at(bodies, [q, dq, ddq, dddq])
    step = 1e-5

    def moved(t: float) -> PointMotion:
        return at(
            bodies,
            [
                q + t * dq + t**2 / 2 * ddq + t**3 / 6 * dddq,
                dq + t * ddq + t**2 / 2 * dddq,
                ddq + t * dddq,
                dddq,
            ],
        )

    before, after = moved(-step), moved(step)
    for order in (1, 2):
        slope = (after.columns[order - 1] - before.columns[order - 1]) / (2 * step)
        np.testing.assert_allclose(slope, points.columns[order], atol=1e-6)
    np.testing.assert_allclose((after.acceleration - before.acceleration) / (2 * step), points.jerk, atol=1e-6)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_norms_of_body_point_slopes_agree_with_finite_differences(name: str) -> None:
    arm = ARMS[name]()
    bodies, parts = BodyPoints.of(arm), motion(arm, 5)
    path = Path.of(bodies, BodyBand(0.0, 0.0).region(bodies), still(*parts))
    step, n = 1e-5, arm.joints
    slopes = []
    for row in step * np.eye(n):
        ahead, behind = (at(bodies, [parts[0] + shift, *parts[1:]]).columns[0] for shift in (row, -row))
        slopes.append((ahead - behind) / (2 * step) @ path.root)
    unit = at(bodies, parts).columns[0] @ path.root
    for each, bound, columns in (
        (path.norms.slopes, path.norms.slopes_norm, slopes),
        (path.norms.turning, path.norms.turning_norm, [unit.swapaxes(1, 2) @ slope for slope in slopes]),
    ):
        sizes = np.stack([np.linalg.norm(part, axis=(1, 2)) for part in columns], axis=1)
        np.testing.assert_allclose(each, sizes, rtol=1e-6, atol=1e-8)
        # A sum over the joints has its maximum at a velocity of norm 1; 200 such velocities are tried.
        velocity = np.random.default_rng(0).normal(size=(200, 5, n, 1))
        velocity = (path.root @ velocity)[..., 0] / np.linalg.norm(velocity, axis=2)
        sums = np.einsum("snj,jnab->snab", velocity, np.stack(columns))
        largest = np.linalg.norm(sums, 2, axis=(2, 3)).max(axis=0)
        assert np.all((0.3 * bound < largest) & (largest <= bound * (1 + 1e-6)))


def test_arm_at_the_edge_of_the_band_changes_torques_within_the_bound() -> None:
    """`|xᵀ (E q̈ + Δn)| <= p Σ_b ‖Y_b x‖ ‖F_b‖`, for members at the edge of the band."""
    from .plant import Chain

    arm, rng, p = panda(), np.random.default_rng(3), 0.1
    bodies, chain = BodyPoints.of(arm), Chain.of(arm)
    q, dq, ddq, dddq = motion(arm)
    points = at(bodies, [q, dq, ddq, dddq])
    shape = (len(q), arm.joints, 12)
    force = np.linalg.norm(points.acceleration.reshape(shape), axis=2)
    for _ in range(10):
        other = torque_of(chain.member(rng, p), q, dq, ddq)
        apart = other - torque_of(chain, q, dq, ddq)
        for x in rng.normal(size=(10, arm.joints)):
            moved = np.linalg.norm((points.columns[0] @ x).reshape(shape), axis=2)
            allowed = p * (np.sum(moved * force, axis=1) + np.abs(ddq * x) @ bodies.rotors)
            assert np.all(np.abs(apart @ x) <= allowed * (1 + 1e-9) + 1e-12)


def torque_of(chain: Any, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    import ctypes

    from .plant import library

    arm, result = chain.struct(), np.zeros_like(q)
    for i in range(len(q)):
        each = [np.ascontiguousarray(part[i]) for part in (q, dq, ddq)]
        pointers = [part.ctypes.data_as(ctypes.c_void_p) for part in each]
        row = np.zeros(q.shape[1])
        library().torques(ctypes.byref(arm), *pointers, ctypes.c_double(1.0), row.ctypes.data_as(ctypes.c_void_p))
        result[i] = row
    return result
