"""Piecewise motions have correct derivatives at and outside their knots, and exact extremes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.motions import MinimumJerk, Tabulated, Trapezoidal
from slidax.motions.trajectory import AbstractPiecewisePolynomial
from tests.enrolled import every

from .differentiated import derivative
from .members import TRAJECTORIES

PIECEWISE = [(name, motion) for name, motion in TRAJECTORIES if isinstance(motion, AbstractPiecewisePolynomial)]


def polynomial_derivative(motion, piece, joint, order, x):
    """From the coefficients alone, by numpy."""
    powers = np.asarray(motion.coefficients)[:, piece, joint]
    return np.polyval(np.polyder(powers, order) if order else powers, x)


@every("motion", PIECEWISE)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_values_at_a_knot_are_those_of_the_piece_that_begins_there(motion, order):
    knots = np.asarray(motion.times)
    values = derivative(motion, order, knots[:-1])
    for piece in range(len(knots) - 1):
        for joint in range(2):
            expected = polynomial_derivative(motion, piece, joint, order, 0.0)
            np.testing.assert_allclose(values[piece, joint], expected, atol=1e-12)


@every("motion", PIECEWISE)
def test_motion_stands_still_before_the_first_and_after_the_last_knot(motion):
    first, last = float(motion.times[0]), float(motion.times[-1])
    outside = np.array([first - 5.0, first - 1e-9, last, last + 1e-9, last + 100.0])
    for order in (1, 2):
        np.testing.assert_array_equal(derivative(motion, order, outside), 0.0)
    place = derivative(motion, 0, outside)
    np.testing.assert_allclose(place[:2], np.tile([0.0, 1.0], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(place[2:], np.tile([-0.3, 0.6], (3, 1)), atol=1e-12)


@every("motion", PIECEWISE)
@pytest.mark.parametrize("order", [0, 1])
def test_position_and_velocity_do_not_jump_at_any_knot(motion, order):
    h = 1e-9
    knots = np.asarray(motion.times)
    np.testing.assert_allclose(derivative(motion, order, knots - h), derivative(motion, order, knots + h), atol=1e-7)


@every("motion", PIECEWISE)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_extremes_are_those_of_a_dense_search(motion, order):
    extremes = motion.extremes(order)
    knots = np.asarray(motion.times)
    x = np.linspace(0.0, 1.0, 4001)
    for joint in range(2):
        pieces = range(len(knots) - 1)
        dense = np.concatenate(
            [polynomial_derivative(motion, i, joint, order, x * (knots[i + 1] - knots[i])) for i in pieces]
        )
        size = np.abs(dense).max()
        assert extremes.least[joint] <= dense.min() + 1e-12 * size
        assert extremes.largest[joint] >= dense.max() - 1e-12 * size
        np.testing.assert_allclose(extremes.least[joint], dense.min(), atol=1e-6 * size)
        np.testing.assert_allclose(extremes.largest[joint], dense.max(), atol=1e-6 * size)
        np.testing.assert_allclose(extremes.size[joint], size, rtol=1e-6)


@every("motion", PIECEWISE)
def test_extremes_occur_at_their_reported_times(motion):
    position = motion.extremes(0)
    for value, when in ((position.least, position.when_least), (position.largest, position.when_largest)):
        there = derivative(motion, 0, when)
        np.testing.assert_allclose(np.diagonal(there), value, atol=1e-9)


def test_negligible_leading_coefficients_hide_no_extreme():
    """A leading coefficient of 1e-20 sends one root towards infinity, and the others must not go with it."""
    generator = np.random.default_rng(0)
    x = np.linspace(0.0, 2.0, 2001)
    for size in 10.0 ** np.arange(-30, -8):
        powers = generator.normal(size=(6, 1, 60))
        powers[0] *= size
        extremes = Tabulated(times=[0.0, 2.0], coefficients=powers).extremes(0)
        dense = np.polyval(powers[:, 0], x[:, None])
        assert np.all(extremes.largest >= dense.max(axis=0) - 1e-12)
        assert np.all(extremes.least <= dense.min(axis=0) + 1e-12)


def test_until_is_the_end_of_the_motion():
    assert float(MinimumJerk.through([0.5, 2.0], [[0.0], [1.0]]).until) == 2.0
    ends = {name: float(np.asarray(motion.until)) for name, motion in TRAJECTORIES}
    assert ends["constant"] == 0.0
    assert ends["exponential_sum"] == ends["sinusoid"] == np.inf
    assert ends["tabulated"] == 3.1


def test_motions_with_equal_numbers_of_knots_can_be_batched():
    motions = [
        Trapezoidal.through([[0.0, 0.0], goal], velocity=10.0, acceleration=[1.0, 1.0]) for goal in ([1, 2], [2, 4])
    ]
    assert motions[0].coefficients.shape == motions[1].coefficients.shape
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *motions)
    t = jnp.asarray(0.7)
    together = jax.vmap(lambda motion: motion.reference(t))(batch)
    for index, motion in enumerate(motions):
        np.testing.assert_allclose(together.q[index], motion.reference(t).q, rtol=1e-14)
        np.testing.assert_allclose(together.ddq[index], motion.reference(t).ddq, rtol=1e-14)


@pytest.mark.parametrize(
    ("times", "shape", "message"),
    [
        ([0.0, 1.0, 2.0], (4, 1, 2), "with a piece from each knot to the next"),
        ([0.0, 0.0], (4, 1, 2), "times` must increase"),
        ([0.0, np.inf], (4, 1, 2), "times` must be finite; got inf for entry 2"),
    ],
)
def test_coefficients_that_do_not_fit_their_knots_are_refused(times, shape, message):
    with pytest.raises(DefinitionError, match=message):
        Trapezoidal(times=times, coefficients=np.zeros(shape))
