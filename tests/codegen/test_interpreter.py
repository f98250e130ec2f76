"""The interpreter that printers are held to: its fused product and its blocks."""

from fractions import Fraction

import numpy as np

from slidax.codegen.builder import Builder

from .interpreter import converted, fma, interpreted


def exactly(a, b, c):
    return float(Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c)))


def test_a_fused_product_is_rounded_once():
    random = np.random.default_rng(3)
    a, b = random.normal(size=(2, 3000))
    # Sums that cancel nearly all, that lie beside a half of the last place, and that hardly reach it.
    c = np.concatenate(
        [-a[:1000] * b[:1000], -np.float32(a[1000:2000] * b[1000:2000]), np.exp2(random.uniform(-80, 80, 1000))]
    )
    b[2500:] = 1.0 + 2.0 ** -random.integers(1, 53, 500)
    np.testing.assert_array_equal(fma(a, b, c), [exactly(*abc) for abc in zip(a, b, c, strict=True)])


def test_a_fused_product_is_rounded_once_at_the_ends_of_the_range():
    a = np.array([1e300, 1e300, 3e-200, 1e-300, 5e-324, np.inf, np.nan, 0.0, 1e308])
    b = np.array([1e8, 1e8, 1e-124, 1e-300, 0.5, 2.0, 1.0, 5.0, 10.0])
    c = np.array([-1e308, np.inf, 5e-324, -1e-320, 5e-324, 1.0, 1.0, -0.0, -np.inf])
    with np.errstate(all="ignore"):
        result = fma(a, b, c)
    expected = [exactly(1e300, 1e8, -1e308), np.inf, exactly(3e-200, 1e-124, 5e-324), -1e-320]
    np.testing.assert_array_equal(result, [*expected, exactly(5e-324, 0.5, 5e-324), np.inf, np.nan, 0.0, -np.inf])


def test_a_fused_product_of_single_precision_is_rounded_once():
    a, b, c = np.random.default_rng(4).normal(size=(3, 2000)).astype(np.float32)
    exact = [np.float32(exactly(*abc)) for abc in zip(a, b, -a * b, strict=True)]
    np.testing.assert_array_equal(fma(a, b, -a * b), exact)
    assert fma(a, b, c).dtype == np.float32


def test_numbers_become_integers_towards_zero_and_within_their_range():
    x = np.array([-1.9, 1.9, np.nan, np.inf, -np.inf, 2.0**63, -(2.0**31) - 1])
    np.testing.assert_array_equal(converted(x, np.int32), [-1, 1, 0, 2**31 - 1, -(2**31), 2**31 - 1, -(2**31)])
    assert converted(x, np.int64)[5] == 2**63 - 1
    assert converted(x, np.uint64)[3] == 2**64 - 1


def test_each_sample_turns_as_often_as_its_own_condition_says_and_logs_its_own_rows():
    builder = Builder()
    x = builder.input("x", "f64", (1,))[0]
    zero, one = builder.constant(0, "i64"), builder.constant(1, "i64")
    log = builder.logged("log", "f64", (1,))

    def condition(carried):
        return builder.apply("lt", carried[1], builder.constant(10.0, "f64"))

    def body(carried):
        count, x = carried
        builder.store(log, count, builder.apply("gt", x, builder.constant(2.0, "f64")), np.array([x], object))
        return [builder.apply("add", count, one), builder.apply("mul", x, builder.constant(2.0, "f64"))]

    count, last = builder.loop([zero, x], condition, body)
    builder.output("last", "f64", np.array([last], object))
    builder.output("count", "i64", np.array([count], object))
    rows, last, count = interpreted(builder.finish(), np.array([[1.0], [3.0], [20.0]]))
    np.testing.assert_array_equal(last[:, 0], [16.0, 12.0, 20.0])
    np.testing.assert_array_equal(count[:, 0], [4, 2, 0])
    np.testing.assert_array_equal(rows[:, :, 0], [[0, 0, 4, 8], [3, 6, 0, 0], [0, 0, 0, 0]])


def test_a_branch_leaves_what_its_side_made():
    builder = Builder()
    x = builder.input("x", "f64", (1,))[0]
    when = builder.apply("lt", x, builder.constant(0.0, "f64"))
    left = builder.branch(when, lambda: [builder.apply("neg", x)], lambda: [builder.apply("sqrt", x)])
    builder.output("y", "f64", np.array(left, object))
    np.testing.assert_array_equal(interpreted(builder.finish(), np.array([[-3.0], [4.0]]))[0], [[3.0], [2.0]])
