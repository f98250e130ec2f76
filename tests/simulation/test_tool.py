"""Rotation error of a tool relative to its reference."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slidax import arms
from slidax.simulation.tally import ErrorTally, ToolTally, rotation_angle


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.3, 1.5, 3.0, np.pi - 1e-7, np.pi])
def test_the_angle_between_two_rotations_is_accurate_at_any_size(angle):
    rng = np.random.default_rng(3)
    for _ in range(20):
        axis = rng.standard_normal(3)
        first = Rotation.random(rng=rng)
        second = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)) * first
        measured = rotation_angle(jnp.asarray(second.as_matrix()), jnp.asarray(first.as_matrix()))
        np.testing.assert_allclose(measured, angle, rtol=1e-9, atol=1e-15)


def test_the_rotation_error_has_a_finite_gradient_at_zero():
    arm = arms.panda()
    q = jnp.asarray(arms.built_in_arm("panda").home)
    slope = jax.grad(lambda x: rotation_angle(arm.tip_frame(x)[0], arm.tip_frame(q)[0]))(q)
    assert np.isfinite(slope).all()


def test_the_tools_rotation_error_matches_scipy_rotations():
    arm = arms.panda()
    rng = np.random.default_rng(4)
    tally, yes = ToolTally.begin(arm), jnp.asarray(True)
    angles = []
    for _ in range(5):
        wanted = jnp.asarray(arms.built_in_arm("panda").home + 0.2 * rng.standard_normal(7))
        q = wanted + 0.1 * rng.standard_normal(7)
        between = Rotation.from_matrix(arm.tip_frame(q)[0]) * Rotation.from_matrix(arm.tip_frame(wanted)[0]).inv()
        angles.append(between.magnitude())
        tally = tally.add(arm, q, wanted, yes, yes)
    assert isinstance(tally.rotation, ErrorTally)
    np.testing.assert_allclose(tally.rotation.error, max(angles), rtol=1e-9)
    np.testing.assert_allclose(tally.rotation.square, np.sum(np.square(angles)), rtol=1e-9)
