"""Expanded elementary functions: accuracy, special cases and shared operations."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
import scipy.special

from slidax.codegen.builder import Builder
from slidax.codegen.elementary import lower
from slidax.codegen.ir import ELEMENTARY, Branch

from .compiled_c import compiled, needs_a_compiler
from .interpreter import interpreted

TWO_ARGUMENTS = ("pow", "atan2")
# Largest error of the reference: small if its floats are longer than f64, else that of f64.
REFERENCE_ULPS = 0.01 if np.finfo(np.longdouble).nmant > 60 else 1.0
SPECIAL = [0.0, 1.0, 2.0, 3.0, 0.5, 2.5, 0.3, 100.0, 709.9, 710.3, 745.2, 1023.5, 1024.0, 1075.0, 1e300, 1e308]
SPECIAL += [2.0**52 + 1, 2.0**53, 2.0**53 + 2, 1e-300, 1e-310, 5e-324, 1.0 - 2.0**-53, 1.0 + 2.0**-52, math.inf]
SPECIAL = np.array([sign * x for x in SPECIAL for sign in (1.0, -1.0)] + [math.nan])
RANDOM = np.random.default_rng(5)


def program_of(ops, type="f64", exponent=None):
    """A program that computes each function of the same inputs; `exponent` replaces the second input."""
    builder = Builder()
    x, y = builder.input("x", type, (2,))
    if exponent is not None:
        y = builder.constant(exponent, type)
    values = [lower(builder, op, (x, y) if op in TWO_ARGUMENTS else (x,)) for op in ops]
    builder.output("results", type, np.array(values, object))
    return builder.finish()


def computed(op, x, y=0.0, **options):
    x, y = np.broadcast_arrays(x, y)
    return interpreted(program_of([op], **options), np.stack([x, y], axis=1))[0][:, 0]


def reference(op, x, y=0.0):
    """Results of the C library in its longest float type."""
    arguments = [np.asarray(x, np.longdouble), np.asarray(y, np.longdouble)][: 1 + (op in TWO_ARGUMENTS)]
    names = {"pow": "power", "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2"}
    with np.errstate(all="ignore"):
        if op == "erf":
            return np.array([math.erf(z) for z in np.asarray(x)])
        if op == "erf_inv":
            return np.copysign(scipy.special.erfinv(x), x)
        return getattr(np, names.get(op, op))(*arguments)


def ulps(result, expected):
    """Error in units in the last place; zero if both are NaN or the same infinity."""
    with np.errstate(all="ignore"):
        rounded = expected.astype(np.float64)
        off = np.abs(result - expected) / np.spacing(np.abs(rounded))
    return np.where((result == rounded) | (np.isnan(result) & np.isnan(rounded)), 0.0, off)


def linear(low, high, count=1500):
    return RANDOM.uniform(low, high, count)


def geometric(low, high, count=1500):
    return RANDOM.choice([-1.0, 1.0], count) * np.exp2(RANDOM.uniform(np.log2(low), np.log2(high), count))


def near_quarters(turns):
    """Numbers near multiples of pi/2, where a sine or a cosine nearly vanishes."""
    return np.rint(linear(-turns, turns)) * (np.pi / 2) * (1.0 + RANDOM.integers(-3, 4, 1500) * 2.0**-53)


ANGLES = [linear(-4, 4), geometric(1e-300, 1e3), linear(-1e7, 1e7), near_quarters(100), near_quarters(6e6)]
ANGLES += [geometric(1e6, 1e17), geometric(1e15, 1.7e308), near_quarters(1e15)]
ARCS = [linear(-1, 1), geometric(1e-300, 1), linear(0.49, 0.51), linear(0.999, 1)]
HYPERBOLIC = [linear(-1, 1), linear(-25, 25), linear(-710.4, 710.4), geometric(1e-300, 1)]
PROMISED = {
    "exp": (1.1, [linear(-708, 709.78), linear(-1, 1), geometric(1e-20, 1)]),
    "expm1": (2.2, [linear(-708, 709.78), linear(-1, 1), geometric(1e-300, 1)]),
    "log": (1.0, [abs(geometric(5e-324, 1.7e308)), linear(0.5, 2), linear(0.99, 1.01)]),
    "log1p": (1.0, [linear(-1, 1), geometric(1e-300, 0.5), abs(geometric(1, 1e300))]),
    "sin": (1.1, ANGLES),
    "cos": (1.1, ANGLES),
    "tan": (2.6, ANGLES),
    "asin": (2.4, ARCS),
    "acos": (1.4, ARCS),
    "atan": (1.8, [linear(-5, 5), geometric(1e-300, 1e300), linear(0.99, 1.03)]),
    "sinh": (2.6, HYPERBOLIC),
    "cosh": (1.6, HYPERBOLIC),
    "tanh": (2.8, HYPERBOLIC),
    "erf": (2.8, [linear(-1, 1), linear(-6, 6), geometric(1e-300, 1)]),
    "cbrt": (0.8, [linear(1, 8), geometric(5e-324, 1.7e308)]),
}


@pytest.mark.parametrize("op", PROMISED)
def test_an_elementary_function_has_its_stated_accuracy(op):
    promised, points = PROMISED[op]
    x = np.concatenate(points)
    assert ulps(computed(op, x), reference(op, x)).max() <= promised + REFERENCE_ULPS


@pytest.mark.parametrize(
    ("bases", "exponents", "promised"),
    [
        (abs(geometric(1e-5, 1e5, 4000)), linear(-50, 50, 4000), 1.1),
        (abs(geometric(5e-324, 1e300, 4000)), linear(-1.1, 1.1, 4000), 1.1),
        (linear(0.9999, 1.0001, 4000), linear(-7e6, 7e6, 4000), 1.1),
        (-abs(geometric(1e-5, 1e5, 4000)), np.rint(linear(-40, 40, 4000)), 1.1),
        (linear(0.7, 0.76, 4000), linear(-1500, 1500, 4000), 1.8),
        (linear(1.3, 1.42, 4000), linear(-1500, 1500, 4000), 1.8),
    ],
)
def test_a_power_is_accurate_for_any_exponent(bases, exponents, promised):
    assert (
        ulps(computed("pow", bases, exponents), reference("pow", bases, exponents)).max() <= promised + REFERENCE_ULPS
    )


def test_atan2_is_accurate_for_near_and_far_points():
    y = np.concatenate([linear(-1, 1), geometric(1e-300, 1e300), geometric(1e-320, 1e-300)])
    x = np.concatenate([linear(-1, 1), geometric(1e-300, 1e300), geometric(1e-320, 1e-300)])
    assert ulps(computed("atan2", y, x), reference("atan2", y, x)).max() <= 2.0 + REFERENCE_ULPS


def test_the_inverse_error_function_undoes_the_error_function():
    x = np.concatenate([linear(-1, 1), geometric(1e-300, 1), 1.0 - abs(geometric(2.0**-53, 0.5))])
    y = computed("erf_inv", x)
    assert np.abs(y / reference("erf_inv", x) - 1.0).max() < 1e-14
    core = np.abs(y) < 2.0
    assert np.abs(computed("erf", y[core]) / x[core] - 1.0).max() < 1e-14


@pytest.mark.parametrize("op", [op for op in ELEMENTARY if op not in TWO_ARGUMENTS])
def test_special_cases_are_those_of_the_c_standard(op):
    assert_alike(computed(op, SPECIAL), reference(op, SPECIAL))


@pytest.mark.parametrize("op", TWO_ARGUMENTS)
def test_special_cases_of_two_arguments_are_those_of_the_c_standard(op):
    x, y = (grid.ravel() for grid in np.meshgrid(SPECIAL, SPECIAL))
    assert_alike(computed(op, x, y), reference(op, x, y))


@pytest.mark.parametrize("exponent", [0.0, -0.0, 1.5, -2.5, 3.0, -3.0, -4.0, math.inf, -math.inf, math.nan])
def test_power_with_a_constant_exponent_keeps_the_special_cases(exponent):
    assert_alike(computed("pow", SPECIAL, exponent=exponent), reference("pow", SPECIAL, exponent))


def assert_alike(result, expected):
    with np.errstate(over="ignore"):
        expected = expected.astype(np.float64)
    np.testing.assert_array_equal(np.isnan(result), np.isnan(expected))
    number = ~np.isnan(result)
    np.testing.assert_array_equal(np.signbit(result[number]), np.signbit(expected[number]))
    np.testing.assert_allclose(result, expected, rtol=1e-15, atol=1e-323)


def test_subnormal_results_are_accurate_to_their_spacing():
    spacing = 5e-324
    x = linear(-745.2, -708.3)
    assert np.abs(computed("exp", x) - reference("exp", x)).max() <= spacing
    y = linear(-1100, -1020)
    assert np.abs(computed("pow", 2.1, y) - reference("pow", 2.1, y)).max() <= spacing
    tiny = geometric(5e-324, 2.0**-1022)
    for op in ("sin", "tan", "asin", "atan", "sinh", "tanh", "expm1", "log1p"):
        assert np.abs(computed(op, tiny) - tiny).max() <= spacing


# By continued fractions, these floats are the nearest of their size to multiples of pi/2; the last is
# near a multiple, and its product with 2/pi has a carry in the middle.
NEAREST = [45.553093477052, 321307.9594422229, 1698673.2849629424, 6794693.139851769, 2.1684714451092387e20]
NEAREST += [3.8281827772588983e59, 6.426511099577231e173, 5.319372648326541e255, 5.828466862870158e282]
NEAREST += [2.167286360105717e198]


@pytest.mark.parametrize("op", ["sin", "cos", "tan"])
def test_circular_functions_are_accurate_near_multiples_of_a_quarter_turn(op):
    angles = np.array(NEAREST)
    assert ulps(computed(op, angles), reference(op, angles)).max() <= 1.6 + REFERENCE_ULPS


def test_single_precision_is_computed_in_double_and_rounded():
    x = np.float32(linear(0.1, 3))
    single = computed("exp", x, type="f32")
    assert single.dtype == np.float32
    np.testing.assert_array_equal(single, np.exp(x.astype(np.float64)).astype(np.float32))
    np.testing.assert_array_equal(computed("pow", x, x, type="f32"), computed("pow", x, x).astype(np.float32))


def test_exactly_the_elementary_functions_are_expanded():
    program = program_of(ELEMENTARY)
    assert not {value.op for value in program.walk()} & set(ELEMENTARY)
    builder = Builder()
    x = builder.input("x", "f64", (1,))[0]
    assert lower(builder, "sqrt", (x,)) is None


@needs_a_compiler
def test_expansions_compiled_from_c_give_the_interpreters_bits(tmp_path):
    program = program_of(ELEMENTARY)
    run = compiled(program, tmp_path)
    x = np.stack([np.concatenate([linear(-1, 1, 60), geometric(1e-3, 1e9, 60)]) for _ in range(2)], axis=1)
    by_compiler = np.array([run([row])[0] for row in x])
    np.testing.assert_array_equal(by_compiler, interpreted(program, x)[0])


def test_sine_and_cosine_of_one_angle_share_all_but_the_signs():
    both, sine = (Counter(value.op for value in program_of(ops).walk()) for ops in (["sin", "cos"], ["sin"]))
    assert both["fma"] == sine["fma"] and both["branch"] == 1
    assert both.total() - sine.total() <= 8


def test_powers_and_the_logarithm_of_one_number_share_the_division():
    builder = Builder()
    x, a, b = builder.input("x", "f64", (3,))
    values = [lower(builder, "pow", (x, a)), lower(builder, "pow", (x, b))]
    values.append(lower(builder, "log", (builder.apply("abs", x),)))
    builder.output("results", "f64", np.array(values, object))
    assert sum(value.op == "div" for value in builder.finish().walk()) == 1


def test_a_nonnegative_base_needs_no_test_for_odd_exponents():
    builder = Builder()
    x, y = builder.input("x", "f64", (2,))
    power = lower(builder, "pow", (builder.apply("abs", x), y))
    builder.output("results", "f64", np.array([power], object))
    program = builder.finish()
    assert "rint" not in {value.op for value in program.walk()}
    bases = np.stack([linear(-3, 3), linear(-3, 3)], axis=1)
    np.testing.assert_array_equal(interpreted(program, bases)[0][:, 0], computed("pow", abs(bases[:, 0]), bases[:, 1]))


def test_the_sine_of_a_loop_invariant_angle_is_computed_before_the_loop():
    builder = Builder()
    angle = builder.input("angle", "f64", (1,))[0]
    turns, zero, unit = (builder.constant(k, "i64") for k in (3, 0, 1))

    def body(carried):
        return [
            builder.apply("add", carried[0], unit),
            builder.apply("add", carried[1], lower(builder, "sin", (angle,))),
        ]

    def condition(carried):
        return builder.apply("lt", carried[0], turns)

    _, total = builder.loop([zero, builder.constant(0.0, "f64")], condition, body, turns)
    builder.output("total", "f64", np.array([total], object))
    program = builder.finish()
    assert all(value.region is program.body for value in program.walk() if isinstance(value, Branch))
    angles = np.array([[0.3], [1e12]])
    np.testing.assert_allclose(interpreted(program, angles)[0], 3 * np.sin(angles), rtol=1e-15)
