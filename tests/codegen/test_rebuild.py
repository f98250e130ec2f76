from __future__ import annotations

import numpy as np
import pytest

from slidax.codegen.builder import Builder
from slidax.codegen.passes import fuse_products, rebuild

from .interpreter import interpreted
from .random_programs import RandomProgram, random_arrays


def same(builder, value, args):
    return None


def ops(program):
    return [value.op for value in program.walk()]


def bits(arrays):
    return [array.tobytes() for array in arrays]


@pytest.mark.parametrize("seed", range(8))
def test_a_rebuilt_program_is_the_same_function_and_not_longer(seed):
    program = RandomProgram(seed, size=16).finish()
    again = rebuild(program, same)
    assert len(ops(again)) <= len(ops(program))
    arrays = [np.stack(samples) for samples in zip(*(random_arrays(10 * seed + k) for k in range(8)), strict=True)]
    assert bits(interpreted(program, *arrays)) == bits(interpreted(again, *arrays))


def test_a_replaced_value_reaches_all_its_uses_in_loops_and_branches():
    b = Builder()
    x = b.input("x", "f64", ()).item()
    n = b.input("n", "i64", ()).item()
    zero, unit = b.constant(0, "i64"), b.constant(1, "i64")

    def body(carried):
        k, y = carried
        big = b.apply("gt", y, b.constant(3.0, "f64"))
        (y,) = b.branch(big, lambda: [b.apply("exp", y)], lambda: [b.apply("mul", y, b.constant(2.0, "f64"))])
        return [b.apply("add", k, unit), y]

    _, y = b.loop([zero, x], lambda carried: b.apply("lt", carried[0], n), body)
    b.output("y", "f64", np.array(y, object))

    def negated(builder, value, args):
        return builder.apply("neg", args[0]) if value.op == "exp" else None

    program = rebuild(b.finish(), negated)
    assert interpreted(program, np.array([1.0]), np.array([3]))[0] == -4.0


def test_logged_outputs_keep_their_order_and_names():
    b = Builder()
    x = b.input("x", "f64", (2,))
    b.output("first", "f64", x)
    log = b.logged("second", "f64", (2,))
    b.output("third", "f64", x[::-1])
    b.store(log, b.constant(1, "i64"), b.constant(True, "b1"), x)
    program = rebuild(b.finish(), same)
    assert [output.name for output in program.outputs] == ["first", "second", "third"]
    first, second, third = interpreted(program, np.array([[1.0, 2.0]]))
    assert first.tolist() == [[1.0, 2.0]]
    assert second.tolist() == [[[0.0, 0.0], [1.0, 2.0]]]
    assert third.tolist() == [[2.0, 1.0]]


def formula(make):
    """The program of `make(x, y, z, w)`, fused."""
    b = Builder()
    x = b.input("x", "f64", (4,))
    b.output("y", "f64", np.array(make(b, *x), object))
    return rebuild(b.finish(), fuse_products)


X = np.array([[1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0, 3.0]])
REST = -(2.0**-60)  # the product of the first two, less 1; rounding the product loses this


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda b, x, y, z, w: b.apply("add", b.apply("mul", x, y), z), REST),
        (lambda b, x, y, z, w: b.apply("add", z, b.apply("mul", x, y)), REST),
        (lambda b, x, y, z, w: b.apply("sub", b.apply("mul", x, y), b.apply("abs", z)), REST),
        (lambda b, x, y, z, w: b.apply("sub", b.apply("abs", z), b.apply("mul", x, y)), -REST),
    ],
)
def test_product_in_a_sum_becomes_a_fused_multiply_add(make, expected):
    program = formula(make)
    assert "fma" in ops(program) and "mul" not in ops(program)
    assert interpreted(program, X)[0] == expected


def test_later_of_two_products_in_a_sum_is_fused():
    program = formula(lambda b, x, y, z, w: b.apply("add", b.apply("mul", z, w), b.apply("mul", x, y)))
    assert sorted(op for op in ops(program) if op in ("mul", "fma")) == ["fma", "mul"]
    assert interpreted(program, np.array([[*X[0, :2], -1.0, 1.0]]))[0] == REST


def test_integer_products_are_not_fused():
    b = Builder()
    x = b.input("x", "i64", (3,))
    b.output("y", "i64", np.array(b.apply("add", b.apply("mul", x[0], x[1]), x[2]), object))
    assert "fma" not in ops(rebuild(b.finish(), fuse_products))


def test_a_product_outside_a_loop_is_not_fused_into_it():
    b = Builder()
    x, y, z = b.input("x", "f64", (3,))
    n = b.input("n", "i64", ()).item()

    def body(carried):
        return [b.apply("add", carried[0], b.constant(1, "i64")), b.apply("add", carried[1], b.apply("mul", x, y))]

    _, total = b.loop([b.constant(0, "i64"), z], lambda carried: b.apply("lt", carried[0], n), body)
    b.output("total", "f64", np.array(total, object))
    program = rebuild(b.finish(), fuse_products)
    assert "fma" not in ops(program)
    assert [value.op for value in program.body.values].count("mul") == 1
