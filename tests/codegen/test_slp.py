from __future__ import annotations

import numpy as np
import pytest

from slidax.codegen import llvm
from slidax.codegen.builder import Builder
from slidax.codegen.llvm.order import put_in_order
from slidax.codegen.llvm.slp import Bundles, keep_profitable
from slidax.codegen.llvm.vectorise import Vector, lower_and_fuse, vectorise

from .interpreter import interpreted

pytestmark = pytest.mark.usefixtures("folder")


class Joints:
    """A random program of vectors with an element per joint, which are sometimes mixed, reversed or summed."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.builder = Builder()
        self.joints = int(self.random.choice([2, 3, 7]))
        self.vectors = [self.builder.input(name, "f64", (self.joints,)) for name in "xyz"]
        self.numbers = [self.builder.input("gain", "f64", ()).item(), self.builder.constant(0.75, "f64")]

    def pick(self, known):
        return known[-1 - min(int(self.random.exponential(3.0)), len(known) - 1)]

    def apply(self, op, *arrays, type=None):
        """Apply an operation element by element, as a trace does."""
        columns = zip(*(np.broadcast_to(array, self.joints) for array in arrays), strict=True)
        return np.array([self.builder.apply(op, *column, type=type) for column in columns], object)

    def step(self):
        """Add a vector or number."""
        kind = self.random.choice(["two", "two", "two", "one", "mixed", "chosen", "integer", "turned", "sum", "cases"])
        x, y = self.pick(self.vectors), self.pick(self.vectors)
        if kind == "two":
            x = self.apply(self.random.choice(["add", "sub", "mul", "div", "min", "max"]), x, y)
        elif kind == "one":
            x = self.apply(self.random.choice(["neg", "abs", "sqrt", "floor"]), x)
        elif kind == "mixed":
            x = self.apply(self.random.choice(["add", "mul", "sub"]), x, self.pick(self.numbers))
        elif kind == "chosen":
            x = self.apply("select", self.apply("lt", x, y), x, self.apply("neg", y))
        elif kind == "integer":
            bits = self.apply("bitcast", x, type="u64")
            x = self.apply("convert", self.apply("shr", bits, self.builder.constant(20, "u64")), type="f64")
        elif kind == "turned":
            x = np.roll(x, 1)
        elif kind == "sum":
            total = x[0]
            for element in x[1:]:
                total = self.builder.apply("add", total, element)
            self.numbers.append(total)
        else:
            x = np.array([self.cases(*pair) for pair in zip(x, y, strict=True)], object)
        self.vectors.append(x)

    def cases(self, x, y):
        b = self.builder
        when = b.apply("gt", x, b.constant(0.5, "f64"))
        return b.branch(when, lambda: [b.apply("sqrt", b.apply("add", x, y))], lambda: [b.apply("sub", y, x)])[0]

    def loop(self):
        """Add a loop of three iterations that carries two vectors and a number."""
        b, n = self.builder, self.joints
        zero, unit, last = (b.constant(k, "i64") for k in (0, 1, 3))
        start = [zero, *self.pick(self.vectors), *self.vectors[0], self.pick(self.numbers)]

        def body(carried):
            known = self.vectors, self.numbers
            self.vectors = [*self.vectors, np.array(carried[1 : n + 1]), np.array(carried[n + 1 : 2 * n + 1])]
            self.numbers = [*self.numbers, carried[-1]]
            for _ in range(12):
                self.step()
            left = [*self.pick(self.vectors), *self.pick(self.vectors), self.pick(self.numbers)]
            self.vectors, self.numbers = known
            return [b.apply("add", carried[0], unit), *left]

        left = b.loop(start, lambda carried: b.apply("lt", carried[0], last), body, last)
        self.vectors += [np.array(left[1 : n + 1]), np.array(left[n + 1 : 2 * n + 1])]
        self.numbers.append(left[-1])

    def finish(self):
        """The program."""
        for _ in range(2):
            for _ in range(8):
                self.step()
            self.loop()
        for k, vector in enumerate(self.vectors[-8:]):
            self.builder.output(f"vector{k}", "f64", vector)
        self.builder.output("numbers", "f64", np.array(self.numbers, object))
        return self.builder.finish()


@pytest.mark.parametrize("seed", range(12))
def test_vectorised_programs_give_the_interpreters_bits(seed):
    joints = Joints(seed)
    program = joints.finish()
    numbers = np.random.default_rng(seed).normal(size=(3, joints.joints))
    arrays = [*numbers, np.array(1.5)]
    expected = interpreted(lower_and_fuse(program), *(array[None] for array in arrays))
    done = llvm.compile(program)(arrays)
    assert [array.tobytes() for array in done] == [array[0].tobytes() for array in expected]


def vectors_of(program):
    return [value for value in program.walk() if isinstance(value, Vector)]


def scalars(joints, law):
    """The program of `law(b, q, dq, gain)` with vectors of joints."""
    b = Builder()
    q, dq = b.input("q", "f64", (joints,)), b.input("dq", "f64", (joints,))
    b.output("tau", "f64", np.array(law(b, q, dq, b.input("gain", "f64", ()).item()), object))
    return b.finish()


def packed(joints, law):
    """The program of `scalars` with its vectors packed."""
    program = scalars(joints, law)
    vectorise(program)
    put_in_order(program)
    return program


@pytest.mark.parametrize("joints", [2, 3, 7])
def test_operations_common_to_all_joints_become_one_vector_operation(joints):
    def law(b, q, dq, gain):
        return [b.apply("sqrt", b.apply("add", b.apply("mul", gain, x), v)) for x, v in zip(q, dq, strict=True)]

    program = packed(joints, law)
    lanes = [(v.op, v.lanes) for v in vectors_of(program) if v.op in ("mul", "add", "sqrt")]
    assert lanes == [("mul", joints), ("add", joints), ("sqrt", joints)]
    assert not [v for v in program.walk() if v.op in ("mul", "add", "sqrt") and not isinstance(v, Vector)]


def test_scalars_are_gathered_for_later_vector_operations():
    def law(b, q, dq, gain):
        # The accelerations of the two joints have different formulas, but enter the same operations.
        ddq = [b.apply("mul", b.apply("sub", q[0], q[1]), gain), b.apply("div", gain, q[1])]
        dq = [b.apply("fma", gain, a, v) for a, v in zip(ddq, dq, strict=True)]
        return [b.apply("sqrt", b.apply("mul", v, v)) for v in dq]

    assert {"gather", "fma", "mul", "sqrt"} <= {value.op for value in vectors_of(packed(2, law))}


def test_sums_with_swapped_operands_are_vectorised():
    def law(b, q, dq, gain):
        squares = [b.apply("mul", x, x) for x in q]
        later = b.apply("floor", b.apply("mul", squares[0], gain))
        return [b.apply("sqrt", x) for x in (b.apply("add", squares[0], later), b.apply("add", gain, squares[1]))]

    program = packed(2, law)
    (total,) = [value for value in vectors_of(program) if value.op == "add"]
    assert [value.op for value in total.args] == ["mul", "gather"]


def test_dependent_values_do_not_share_a_vector():
    def law(b, q, dq, gain):
        first = b.apply("mul", q[0], gain)
        second = b.apply("mul", q[1], gain)
        # The second sum depends on the first, so a vector cannot compute both.
        low = b.apply("add", first, b.constant(1.0, "f64"))
        return [low, b.apply("add", b.apply("mul", second, low), b.constant(1.0, "f64"))]

    program = packed(2, law)
    (tau,) = llvm.compile(scalars(2, law))([np.array([2.0, 3.0]), np.zeros(2), np.array(0.5)])
    assert tau.tolist() == [2.0, 4.0]
    assert not [v for v in vectors_of(program) if v.op == "add"]


def test_programs_with_cyclic_bundle_dependencies_compute_correct_results():
    b = Builder()
    x, y = b.input("x", "f64", (2,)), b.input("y", "f64", (2,))
    p0 = b.apply("mul", x[0], y[0])
    s1 = b.apply("add", x[1], y[1])
    p1 = b.apply("mul", x[1], b.apply("sub", y[1], s1))
    s0 = b.apply("add", x[0], b.apply("sub", y[0], p0))
    b.output("z", "f64", np.array([p0, p1, s0, s1], object))
    program = b.finish()
    expected = interpreted(program, np.array([[1.0, 2.0]]), np.array([[3.0, 5.0]]))[0]
    (done,) = llvm.compile(program)([np.array([1.0, 2.0]), np.array([3.0, 5.0])])
    np.testing.assert_array_equal(done, expected[0])


def test_a_vector_that_is_only_unpacked_is_not_built():
    b = Builder()
    x = b.input("x", "f64", (2,))
    squares = [b.apply("mul", element, element) for element in x]
    b.output("norm", "f64", np.array(b.apply("add", *squares), object))
    b.output("first", "f64", np.array(b.apply("sub", *squares), object))
    bundles = Bundles(b.finish())
    assert tuple(squares) in bundles.vectors
    keep_profitable(bundles)
    assert tuple(squares) not in bundles.vectors


def test_loop_variables_of_all_joints_stay_in_one_vector():
    b = Builder()
    q, dq = b.input("q", "f64", (3,)), b.input("dq", "f64", (3,))
    h = b.input("h", "f64", ()).item()
    zero, unit, last = (b.constant(k, "i64") for k in (0, 1, 10))

    def body(carried):
        moved = [b.apply("fma", h, v, x) for x, v in zip(carried[1:4], carried[4:], strict=True)]
        slowed = [b.apply("fma", b.apply("neg", h), x, v) for x, v in zip(moved, carried[4:], strict=True)]
        return [b.apply("add", carried[0], unit), *moved, *slowed]

    left = b.loop([zero, *q, *dq], lambda carried: b.apply("lt", carried[0], last), body, last)
    b.output("q", "f64", np.array(left[1:4], object))
    b.output("dq", "f64", np.array(left[4:], object))
    program = b.finish()
    arrays = np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, -1.0, 0.5]]), np.array([0.125])
    expected = interpreted(program, *arrays)
    kernel = llvm.compile(program)
    assert kernel.text.count("phi <3 x double>") == 2
    for done, right in zip(kernel([array[0] for array in arrays]), expected, strict=True):
        np.testing.assert_array_equal(done, right[0])
