"""Motions through the rows of a table: their interpolation, and the refusal of invalid tables."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PPoly

from slidax.core.errors import DefinitionError
from slidax.motions import MinimumJerk, Tabulated, Trapezoidal

from .differentiated import derivative
from .members import CURVES, PLACES, SPEEDS, TIMES


def sampled(motion, rows):
    """A table of the motion, with velocities and accelerations: by scipy, which compiles nothing."""
    t = np.linspace(float(motion.times[0]), float(motion.times[-1]), rows)
    polynomials = PPoly(np.asarray(motion.coefficients), np.asarray(motion.times))
    return t, *(polynomials(t, order) for order in range(3))


def test_positions_alone_give_the_motion_of_minimum_jerk():
    table, smoothest = Tabulated.through(TIMES, PLACES), MinimumJerk.through(TIMES, PLACES)
    np.testing.assert_array_equal(table.times, smoothest.times)
    np.testing.assert_array_equal(table.coefficients, smoothest.coefficients)


def test_positions_and_velocities_give_the_cubics_of_scipy():
    motion = Tabulated.through(TIMES, PLACES, SPEEDS)
    cubic = CubicHermiteSpline(TIMES, PLACES, SPEEDS)
    t = np.linspace(TIMES[0], TIMES[-1], 501)[1:-1]
    for order in (0, 1, 2):
        np.testing.assert_allclose(derivative(motion, order, t), cubic(t, order), atol=1e-11)


def test_accelerations_give_quintics_with_these_accelerations_at_each_row():
    motion = Tabulated.through(TIMES, PLACES, SPEEDS, CURVES)
    h = 1e-10
    for order, rows in enumerate((PLACES, SPEEDS, CURVES)):
        np.testing.assert_allclose(derivative(motion, order, TIMES[:-1] + h), rows[:-1], atol=1e-7)
        np.testing.assert_allclose(derivative(motion, order, TIMES[1:] - h), rows[1:], atol=1e-7)


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_samples_of_a_motion_reproduce_the_motion(columns):
    """The interpolation error is small for dense rows."""
    original = MinimumJerk.through(TIMES, PLACES)
    t, q, dq, ddq = sampled(original, 401)
    dq[[0, -1]] = 0.0
    again = Tabulated.through(t, *(q, dq, ddq)[:columns])
    between = (t[1:] + t[:-1]) / 2
    # A cubic's acceleration error is the squared spacing times a twelfth of the fourth derivative.
    for order, accuracy in enumerate((1e-8, 1e-6, 2e-3 if columns == 2 else 1e-4)):
        np.testing.assert_allclose(
            derivative(again, order, between), derivative(original, order, between), atol=accuracy
        )


@pytest.mark.parametrize("rows", [30, 100, 1000, 20_000])
def test_accuracy_does_not_depend_on_the_length_of_a_table(rows):
    original = MinimumJerk.through(TIMES, PLACES)
    t, q, _, _ = sampled(original, rows)
    motion = Tabulated.through(t, q)
    np.testing.assert_allclose(derivative(motion, 0, t), q, atol=1e-10)
    knots, h = t[1:-1], 1e-9
    np.testing.assert_allclose(derivative(motion, 1, knots - h), derivative(motion, 1, knots + h), atol=1e-6)
    assert np.abs(derivative(motion, 2, t)).max() < 1.1 * original.extremes(2).size.max()


MOVING = [
    ("ramp", lambda t: t, "at its (start, t = 0|end, t = 2) s"),
    ("sine", lambda t: 0.5 * np.sin(2 * t), "at its start, t = 0 s"),
    ("cosine", lambda t: np.cos(3 * t), "at its end, t = 2 s"),
    ("corner", lambda t: np.where(np.abs(t - 1.0) < 0.5, 0.5 - np.abs(t - 1.0), 0.0), r"at t = (1|0\.9\d*) s"),
]


@pytest.mark.parametrize("rows", [40, 64, 200, 2001])
@pytest.mark.parametrize(("shape", "where"), [case[1:] for case in MOVING], ids=[case[0] for case in MOVING])
def test_a_table_whose_velocity_jumps_is_refused(shape, where, rows):
    t = np.linspace(0.0, 2.0, rows)
    q = np.stack([np.zeros(rows), shape(t)], axis=1)
    with pytest.raises(DefinitionError, match=f"the velocity of joint 2 jumps {where}"):
        Tabulated.through(t, q)


def test_jump_error_names_row_joint_time_size_and_remedy():
    t = np.linspace(1.0, 3.0, 101)
    with pytest.raises(DefinitionError) as refused:
        Tabulated.through(t, np.stack([np.zeros(101), 0.5 * np.sin(2 * (t - 1.0))], axis=1))
    sentence = str(refused.value)
    assert sentence.startswith("the table, row 1: the velocity of joint 2 jumps at its start, t = 1 s, from 0 to 1")
    assert "rad/s (or m/s) within one row" in sentence
    assert "add rows in which it changes" in sentence and "`MinimumJerk.within`" in sentence


def test_a_velocity_jump_is_accepted_if_the_acceleration_limit_permits_it():
    t = np.linspace(0.0, 2.0, 41)
    q = 0.2 * np.sin(2 * t)[:, None]
    with pytest.raises(DefinitionError, match=r"if the arm reaches ([0-9.]+) rad/s²") as refused:
        Tabulated.through(t, q)
    needed = float(str(refused.value).split("arm reaches ")[1].split()[0])
    assert Tabulated.through(t, q, acceleration=needed).extremes(2).size[0] <= needed
    with pytest.raises(DefinitionError, match=f"over its limit of {needed / 2:g} for acceleration"):
        Tabulated.through(t, q, acceleration=needed / 2)


@pytest.mark.parametrize("rows", [15, 40, 100, 1000])
@pytest.mark.parametrize("seed", range(5))
def test_a_table_without_a_velocity_jump_is_accepted(seed, rows):
    generator = np.random.default_rng(seed)
    path = generator.normal(size=(generator.integers(2, 6), 3))
    smooth = MinimumJerk.within(path, velocity=2.0, acceleration=10.0)
    # Rounded to four digits, like many files.
    t, q, _, _ = sampled(smooth, rows)
    if rows <= 100:
        q = np.round(q, 4)
    Tabulated.through(t, q)
    # Here the acceleration jumps, but the velocity does not.
    fast = Trapezoidal.through(path[:2], velocity=2.0, acceleration=4.0)
    t, q, _, _ = sampled(fast, rows)
    Tabulated.through(t, q)


@pytest.mark.parametrize("seed", range(20))
def test_a_table_of_taught_waypoints_is_accepted(seed):
    generator = np.random.default_rng(seed)
    stays = generator.integers(1, 4, 15)
    path = np.repeat(generator.normal(size=(15, 6)), stays, axis=0)
    Tabulated.through(np.arange(len(path)) * 1.5, path)


def test_a_position_step_is_refused_with_the_acceleration_that_it_needs():
    t = np.arange(0.0, 1.0, 0.01)
    q = np.where(t < 0.5, 0.0, 0.3)[:, None]
    with pytest.raises(
        DefinitionError, match=r"would need .* over its limit of 200 for acceleration; the fastest rows "
    ):
        Tabulated.through(t, q)
    with pytest.raises(DefinitionError, match=r"row 50 and row 51, 0.01 s apart: is there a step"):
        Tabulated.through(t, q, np.zeros_like(q))


def test_velocities_must_be_zero_where_the_table_begins_and_ends():
    for row, words in (
        (0, "row 1: joint 2 .* 0.3 rad/s .* at its start, t = 0.5 s.* before"),
        (3, "row 4: .* at its end"),
    ):
        moving = SPEEDS.copy()
        moving[row, 1] = 0.3
        with pytest.raises(DefinitionError, match=words):
            Tabulated.through(TIMES, PLACES, moving)
    rounded = SPEEDS.copy()
    rounded[0, 1] = 1e-9
    assert float(Tabulated.through(TIMES, PLACES, rounded).reference(jnp.asarray(0.5)).dq[1]) == 0.0


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"lower": [-0.2, -1.0]}, r"joint 1 would go to -0.3 at t = 3.1 s, below its limit of -0.2"),
        ({"upper": 0.9}, r"joint 1 would go to 0.9206 at t = 1.52318 s, above its limit of 0.9$"),
        (
            {"velocity": [9.0, 1.0]},
            r"joint 2 would need [0-9.]+ rad/s \(or m/s\) at t = .*over its limit of 1 for velocity",
        ),
        ({"acceleration": 3.0}, r"over its limit of 3 for acceleration"),
        ({"velocity": 0.0}, r"`Tabulated.velocity` must be > 0"),
        ({"upper": [1.0]}, r"`Tabulated.upper` must be one number or one for each of the 2 joints"),
    ],
)
def test_exceeded_or_invalid_limits_are_errors(limits, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.through(TIMES, PLACES, **limits)


def test_limits_reached_exactly_are_accepted():
    motion = Tabulated.through(TIMES, PLACES)
    Tabulated.through(
        TIMES,
        PLACES,
        lower=motion.extremes(0).least,
        upper=motion.extremes(0).largest,
        velocity=motion.extremes(1).size,
        acceleration=motion.extremes(2).size,
    )


def test_a_limit_error_names_degrees_or_wrong_velocities_as_the_likely_cause():
    with pytest.raises(DefinitionError, match=r"positions go to 57.*: are they degrees?"):
        Tabulated.through(TIMES, np.degrees(PLACES), velocity=3.0)
    t, q, dq, _ = sampled(MinimumJerk.through(TIMES, PLACES), 201)
    dq[[0, -1]] = 0.0
    with pytest.raises(DefinitionError, match=r"velocities are 57.* times those that follow from positions and times"):
        Tabulated.through(t, q, np.degrees(dq))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"times": [0.0]}, "needs one row per time"),
        ({"times": [0.5, 1.3, 1.3, 3.1]}, "row 3: time 1.3 s comes after 1.3 s: two rows at one time would be a jump"),
        ({"times": [0.5, 1.3, 1.2, 3.1]}, "row 3: time 1.2 s comes after 1.3 s: the times must increase"),
        ({"times": [0.5, np.nan, 2.0, 3.1]}, "row 2: the time must be a finite number"),
        ({"times": [-0.5, 1.3, 2.0, 3.1]}, "row 1: time -0.5 s: a motion starts at 0 or later"),
        ({"times": 1.7e9 + TIMES}, "this looks like the time of a clock; shift the table to start at 0 with `start=0`"),
        ({"positions": np.where(PLACES == 0.5, np.nan, PLACES)}, "row 3: the position of joint 1 must be a finite"),
        ({"velocities": SPEEDS[:3]}, "needs one row per time and one column per joint"),
        ({"accelerations": CURVES}, "has accelerations but no velocities"),
    ],
)
def test_invalid_tables_are_errors(change, words):
    arguments = {"times": TIMES, "positions": PLACES} | change
    with pytest.raises(DefinitionError, match=words):
        Tabulated.through(**arguments)


@pytest.mark.parametrize(
    ("build", "name"),
    [
        (lambda rows: Tabulated.through([0.0, 1.0], rows), "positions"),
        (lambda rows: Tabulated.through(rows, [[0.0], [1.0]]), "times"),
        (lambda rows: Tabulated.through([0.0, 1.0], [[0.0], [1.0]], velocities=rows), "velocities"),
        (lambda rows: MinimumJerk.through(rows, [[0.0], [1.0]]), "MinimumJerk.times"),
    ],
)
@pytest.mark.parametrize("rows", [[[0.0], [1.0, 2.0]], ["a", "b"]])
def test_ragged_rows_and_text_are_refused_with_the_name_of_the_argument(build, name, rows):
    with pytest.raises(DefinitionError, match=f"`{name}` must be numbers, or rows"):
        build(rows)
