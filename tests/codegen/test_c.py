"""C from programs: that it computes what they compute, without a warning, and that it reads well."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from jax import lax

from slidax import scenarios
from slidax._types import Reference
from slidax.codegen.builder import Builder
from slidax.codegen.c import Dialect, lasting, statements
from slidax.codegen.c.dialect import shortest
from slidax.codegen.trace import trace

from .compiled_c import COMPILERS, GUARDS, compiled, function_text, needs_a_compiler
from .random_programs import random_arrays, random_program

X = jnp.array([0.3, -1.7, 2.5])
Y = jnp.array([1.1, 0.4, -0.6])
P = jnp.abs(Y) + 0.1
N = jnp.array([4, -7, 3])
WITH_NAN = X.at[0].set(jnp.nan)
DIVIDED = jnp.array([7, -7, -(2**63), 5])
EXTREME = jnp.array([jnp.nan, jnp.inf, -jnp.inf, 1e300, -1e300, 2.0**31, -(2.0**31) - 0.9, 2.0**63, -0.9, 2.9])


def lines_of(builder, *outputs, **options):
    """The statements that write values to y[0], y[1], ..."""
    program = builder.program
    assigned = [(f"y[{k}]", value) for k, value in enumerate(outputs)]
    return statements(program, assigned, lambda k, e: f"x[{e}]", **options).lines


def floats(builder, count):
    return [builder.input(f"{'abcdefgh'[k]}", "f64", ())[()] for k in range(count)]


def named(builder, count):
    """Builder inputs that are read by their names."""
    inputs = floats(builder, count)

    def text(*outputs, **options):
        assigned = [(f"y{k}", value) for k, value in enumerate(outputs)]
        read = lambda k, e: builder.program.inputs[k].name  # noqa: E731
        return [line.strip() for line in statements(builder.program, assigned, read, **options).lines if line]

    return inputs, text


# ---- numbers --------------------------------------------------------------------------------------------------------

COMPUTED = {
    "sums": lambda: (lambda x, y: (x + y, x - y, x * y, x / y, -x, jnp.abs(x), jnp.sqrt(jnp.abs(x))), X, Y),
    "integers": lambda: (lambda n: (n + 2, n * 3, n // 2, n % 3, -n, jnp.abs(n), n & 5, n | 8, n ^ 3, ~n), N),
    "division": lambda: (lambda n, m: (lax.div(n, m), lax.rem(n, m)), DIVIDED, jnp.array([2, 0, -1, -3])),
    "shifts": lambda: (lambda n, m: (n << m, n >> m, lax.shift_right_logical(n, m)), N, jnp.array([3, 63, 64])),
    "overflow": lambda: (lambda n: (n + n, n * n, -n, jnp.abs(n), n - 1), jnp.array([2**62, -(2**63), 2**63 - 1])),
    "unsigned": lambda: (lambda n: (n.astype(jnp.uint32) * 3 - 7, n.astype(jnp.uint64) >> 5), N),
    "extremes": lambda: (lambda x, y: (jnp.maximum(x, y), jnp.minimum(y, x), jnp.minimum(x, y)), WITH_NAN, Y),
    "roundings": lambda: (lambda x: (jnp.floor(x), jnp.ceil(x), jnp.round(x), jnp.sign(x)), X * 2),
    "truths": lambda: (lambda b: (b & True, b | ~b, b ^ True, jnp.any(b), jnp.all(b), b.astype(float)), X > 0),
    "to integers": lambda: (lambda x: (x.astype(jnp.int32), x.astype(jnp.int64), x.astype(jnp.uint32)), EXTREME),
    "to unsigned": lambda: (lambda x: x.astype(jnp.uint64), EXTREME),
    "from integers": lambda: (lambda n: (n.astype(float), n.astype(bool), n.astype(jnp.int32)), N),
    "bits": lambda: (lambda x: lax.bitcast_convert_type(x, jnp.uint64), X),
    "bits back": lambda: (lambda n: lax.bitcast_convert_type(n, jnp.float64), jnp.array([0x3FF8000000000000])),
    "finite": lambda: (lambda x: (jnp.isfinite(x), jnp.isnan(x), x != x), EXTREME),
    "a table": lambda: (lambda t, i: (t[i], t[i + 90]), jnp.arange(80.0), 17),
    "a loop": lambda: (lambda x: lax.fori_loop(0, 5, lambda i, a: a * 0.5 + i, x), X),
    "a swap": lambda: (lambda x, y: lax.fori_loop(0, 3, lambda i, a: (a[1], a[0] + a[1]), (x, y)), X, Y),
    "a while": lambda: (lambda x: lax.while_loop(lambda a: jnp.all(a < 9.0), lambda a: a * a + 1.1, x), X),
    "a while that asks what its turn uses": lambda: (
        lambda x: lax.while_loop(lambda a: jnp.sum(a * a) < 90.0, lambda a: a * (1.0 + jnp.sum(a * a)) - 0.1, x),
        X,
    ),
    "a scan": lambda: (lambda x: lax.scan(lambda a, b: (a + b, a * b), 0.5, x), X),
    "a branch": lambda: (lambda x, y: lax.cond(x[0] > y[0], lambda: (x * y, x), lambda: (x + y, y)), X, Y),
    "a loop in a branch": lambda: (
        lambda x: lax.cond(x[0] > 0, lambda: lax.fori_loop(0, 3, lambda i, a: a * a, x), lambda: x),
        X,
    ),
    "a branch in a loop": lambda: (
        lambda x: lax.fori_loop(0, 6, lambda i, a: lax.cond(a[0] > 1, lambda: a * 0.3, lambda: a + x), x),
        X,
    ),
}  # fmt: skip
ELEMENTARY = {
    "powers": lambda: (lambda x, y: (x**y, jnp.exp(y), jnp.expm1(y), jnp.log(x), jnp.log1p(x), jnp.cbrt(y)), P, Y),
    "angles": lambda: (lambda x, y: (jnp.sin(x), jnp.cos(x), jnp.tan(x), jnp.arctan(x), jnp.arctan2(x, y)), X, Y),
    "inverse": lambda: (lambda x: (jnp.arcsin(x), jnp.arccos(x), jnp.sinh(x), jnp.cosh(x), jnp.tanh(x)), Y / 3),
    "errors": lambda: (lambda x: lax.erf(x), jnp.array([1e-9, -0.3, 0.97, 5.0])),
}


CASES = COMPUTED | ELEMENTARY
BITS = ("bits", "bits back")


def all_at_once(names):
    """One function of all arguments of some cases that gives all of their results."""
    made = {name: CASES[name]() for name in names}

    def everything(args):
        return {name: made[name][0](*args[name]) for name in names}

    return everything, {name: list(made[name][1:]) for name in names}


def results(names, folder, **options):
    """What C gives for some cases, by name, and what JAX gives."""
    function, args = all_at_once(names)
    call = compiled(trace(function, args), folder, **options)
    theirs = jax.jit(function)(args)
    ours = call([np.asarray(leaf) for leaf in jax.tree.leaves(args)])
    return jax.tree.unflatten(jax.tree.structure(theirs), ours), theirs


def assert_close(ours, theirs, **tolerance):
    for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(one, other, **tolerance)


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    return results(CASES, tmp_path_factory.mktemp("c"), compiler=COMPILERS[0], flags=GUARDS)


@needs_a_compiler
@pytest.mark.parametrize("name", COMPUTED)
def test_c_computes_what_jax_computes(name, in_c):
    ours, theirs = in_c
    assert_close(ours[name], theirs[name], rtol=4e-16, atol=0)


@needs_a_compiler
@pytest.mark.parametrize("name", ELEMENTARY)
def test_functions_are_those_of_the_math_library(name, in_c):
    ours, theirs = in_c
    assert_close(ours[name], theirs[name], rtol=4e-15, atol=0)


@pytest.mark.skipif("clang" not in COMPILERS, reason="clang is not installed")
def test_two_compilers_agree(in_c, tmp_path):
    ours, _ = results(CASES, tmp_path, compiler="clang")
    assert_close(ours, in_c[0], rtol=1e-15, atol=0)


@needs_a_compiler
def test_a_program_of_floats_has_no_double(tmp_path):
    names = [name for name in CASES if name not in BITS]
    function, args = all_at_once(names)
    assert "double" not in function_text(trace(function, args), "float")
    ours, theirs = results(names, tmp_path, compiler=COMPILERS[-1], real="float")
    assert_close(ours["powers"], theirs["powers"], rtol=1e-6)
    assert_close(ours["angles"], theirs["angles"], rtol=1e-6)


@needs_a_compiler
def test_the_inverse_error_function_is_exact_to_both_ends(tmp_path):
    x = np.array([0.0, 1e-300, 1e-9, -0.3, 0.4999, 0.5, 0.97, 1 - 1e-9, -1 + 1e-16, 1.0, -1.0, 2.0, np.nan])
    ours = compiled(trace(lax.erf_inv, jnp.asarray(x)), tmp_path, compiler=COMPILERS[0], flags=GUARDS)([x])
    np.testing.assert_allclose(ours[0], scipy.special.erfinv(x), rtol=1e-14, atol=0)


@needs_a_compiler
def test_random_programs_give_the_same_bits_as_machine_code(tmp_path):
    llvm = pytest.importorskip("slidax.codegen.llvm")
    pytest.importorskip("llvmlite")
    from slidax.codegen.llvm.prepare import prepared

    for seed in (5, 7, 10, 12, 19, 22):
        program = random_program(seed)
        folder = tmp_path / str(seed)
        folder.mkdir()
        guards = GUARDS if seed % 2 == 0 else []
        ours = compiled(prepared(program), folder, compiler=COMPILERS[(seed % 2) % len(COMPILERS)], flags=guards)
        theirs = llvm.compile(program)
        for arrays in map(random_arrays, range(4)):
            for one, other in zip(ours(arrays), theirs(arrays), strict=True):
                np.testing.assert_array_equal(one, other, err_msg=f"seed {seed}")


@needs_a_compiler
def test_an_output_may_lie_where_an_input_was(tmp_path):
    b = Builder()
    x = b.input("x", "f64", (2,))
    read = lambda k, element: f"state->x[{element}]"  # noqa: E731
    swapped = statements(b.program, [("state->x[0]", x[1]), ("state->x[1]", b.apply("neg", x[0]))], read).lines
    assert [line.strip() for line in swapped] == [
        "const double x_2 = state->x[1];",
        "state->x[1] = -state->x[0];",
        "state->x[0] = x_2;",
    ]
    chained = statements(b.program, [("state->x[0]", x[1]), ("state->x[1]", b.constant(0.0, "f64"))], read).lines
    assert [line.strip() for line in chained] == ["state->x[0] = state->x[1];", "state->x[1] = 0.0;"]


# ---- how it reads ---------------------------------------------------------------------------------------------------


def test_parentheses_are_only_where_they_are_needed():
    b = Builder()
    (x, y, z), text = named(b, 3)
    cases = {
        "x + y * z": b.apply("add", x, b.apply("mul", y, z)),
        "z * (x + y)": b.apply("mul", b.apply("add", x, y), z),
        "x - (y - z)": b.apply("sub", x, b.apply("sub", y, z)),
        "x - y - z": b.apply("sub", b.apply("sub", x, y), z),
        "x / (y * z)": b.apply("div", x, b.apply("mul", y, z)),
        "y / z * x": b.apply("mul", x, b.apply("div", y, z)),
        "y + z + x": b.apply("add", x, b.apply("add", y, z)),
        "2.0 * x": b.apply("mul", x, b.constant(2.0, "f64")),
        "x - 2.0": b.apply("add", b.constant(-2.0, "f64"), x),
        "x + 2.0": b.apply("sub", x, b.constant(-2.0, "f64")),
        "-(x + y)": b.apply("neg", b.apply("add", x, y)),
        "-x * y": b.apply("neg", b.apply("mul", x, y)),
        "x * y * (x * z)": b.apply("mul", b.apply("mul", x, y), b.apply("mul", x, z)),
        "x + y + (x + z)": b.apply("add", b.apply("add", x, y), b.apply("add", x, z)),
        "x * x * x": b.apply("mul", b.apply("mul", x, x), x),
        "pow(x + y, z)": b.apply("pow", b.apply("add", x, y), z),
        "x < y ? x : z": b.apply("select", b.apply("lt", x, y), x, z),
    }
    for expected, value in cases.items():
        written = text(value)
        swapped = expected.replace("x", "a").replace("y", "b").replace("z", "c")
        assert written[-1] == f"y0 = {swapped};", expected


def test_conditions_need_few_parentheses_too():
    b = Builder()
    (x, y, z), text = named(b, 3)
    first, second, third = b.apply("lt", x, y), b.apply("ge", y, z), b.apply("isfinite", z)
    both = b.apply("and", first, second)
    assert text(b.apply("or", both, third))[-1] == "y0 = isfinite(c) || (a < b && b >= c);"
    assert text(b.apply("and", b.apply("or", first, second), third))[-1] == "y0 = isfinite(c) && (a < b || b >= c);"
    assert text(b.apply("not", first))[-1] == "y0 = !(a < b);"
    assert text(b.apply("ne", x, x))[-1] == "y0 = isnan(a);"


@pytest.mark.parametrize(
    ("number", "text"),
    [(0.5, "0.5"), (1.0, "1.0"), (0.001, "1e-3"), (-2.5, "-2.5"), (1e6, "1e6"), (0.0, "0.0"), (100.0, "100.0")],
)
def test_numbers_are_as_short_as_they_can_be(number, text):
    assert Dialect().number(number, "f64") == text
    assert Dialect("float").number(number, "f64") == text + "f"


def test_every_number_reads_back_to_the_same_bits():
    random = np.random.default_rng(3)
    for number in random.integers(0, 2**64, 4000, np.uint64).view(np.float64):
        if math.isfinite(number):
            assert float(shortest(repr(float(number)))) == number
    for number in random.integers(0, 2**32, 4000, np.uint32).view(np.float32):
        if np.isfinite(number):
            assert np.float32(Dialect().number(float(number), "f32").rstrip("f")) == number


def test_a_limit_beyond_floats_stays_a_finite_limit():
    single = Dialect("float")
    assert single.number(1.7e308, "f64") == "3.4028235e38f"
    assert single.number(-1e-300, "f64") == "-1.1754944e-38f"
    assert single.number(math.inf, "f64") == "INFINITY"


def test_what_is_used_once_is_written_where_it_is_used():
    b = Builder()
    (x, y), text = named(b, 2)
    product = b.apply("mul", x, y)
    assert text(b.apply("sin", product)) == ["y0 = sin(a * b);"]
    assert text(b.apply("sin", product), product) == ["const double v1 = a * b;", "y0 = sin(v1);", "y1 = v1;"]


def test_no_line_is_too_long_to_read():
    b = Builder()
    inputs, text = named(b, 8)
    value = inputs[0]
    for k in range(60):
        value = b.apply("sin", b.apply("add", b.apply("mul", value, inputs[k % 8]), inputs[(k + 3) % 8]))
    assert max(map(len, text(value))) <= 100
    assert all(len(re.findall(r"[-+*/(]", line)) < 20 for line in text(value))


def test_a_counted_loop_is_a_for():
    b = Builder()
    x = b.input("x", "f64", (2,))
    zero, one, n = (b.constant(k, "i32") for k in (0, 1, 7))
    left = b.loop(
        [zero, x[0]],
        lambda c: b.apply("lt", c[0], n),
        lambda c: [b.apply("add", c[0], one), b.apply("mul", c[1], x[1])],
        turns=n,
    )
    assert lines_of(b, left[1]) == [
        "    double v1 = x[0];",
        "    for (int32_t i = 0; i < 7; ++i) {",
        "        v1 = x[1] * v1;",
        "    }",
        "",
        "    y[0] = v1;",
    ]


def test_a_loop_updates_what_it_carries_all_at_once():
    b = Builder()
    x = b.input("x", "f64", (2,))
    left = b.loop(
        list(x),
        lambda c: b.apply("lt", c[0], b.constant(9.0, "f64")),
        lambda c: [c[1], b.apply("add", c[0], c[1])],
    )
    assert [line.strip() for line in lines_of(b, *left)] == [
        "double v1 = x[0];",
        "double v2 = x[1];",
        "while (v1 < 9.0) {",
        "const double v3 = v2;",
        "v2 = v1 + v2;",
        "v1 = v3;",
        "}",
        "",
        "y[0] = v1;",
        "y[1] = v2;",
    ]


def test_what_only_one_side_of_a_branch_needs_is_computed_there():
    b = Builder()
    (x, y), text = named(b, 2)
    sine = b.apply("sin", x)
    dear = b.apply("mul", sine, sine)
    long = lambda: [b.apply("exp", b.apply("mul", dear, dear)), b.apply("neg", dear)]  # noqa: E731
    left = b.branch(b.apply("lt", x, y), long, lambda: [x, y])
    assert text(*left) == [
        "double v1 = a;",
        "double v2 = b;",
        "if (a < b) {",
        "const double v3 = sin(a);",
        "const double v4 = v3 * v3;",
        "v1 = exp(v4 * v4);",
        "v2 = -v4;",
        "}",
        "y0 = v1;",
        "y1 = v2;",
    ]


def test_a_short_branch_is_a_choice():
    b = Builder()
    (x, y), text = named(b, 2)
    left = b.branch(b.apply("lt", x, y), lambda: [b.apply("exp", x)], lambda: [b.apply("sin", y)])
    assert text(*left) == ["y0 = a < b ? exp(a) : sin(b);"]


def test_what_does_not_change_in_a_loop_stays_outside():
    b = Builder()
    x = b.input("x", "f64", (2,))
    zero, one, n = (b.constant(k, "i32") for k in (0, 1, 7))
    fixed = b.apply("exp", x[1])
    left = b.loop(
        [zero, x[0]],
        lambda c: b.apply("lt", c[0], n),
        lambda c: [b.apply("add", c[0], one), b.apply("add", c[1], fixed)],
        turns=n,
    )
    lines = [line.strip() for line in lines_of(b, left[1])]
    assert lines.index("const double v1 = exp(x[1]);") < lines.index("for (int32_t i = 0; i < 7; ++i) {")


def test_a_loop_whose_condition_takes_statements_asks_in_its_midst():
    b = Builder()
    x = b.input("x", "f64", (2,))
    left = b.loop(
        [x[0]],
        lambda c: b.apply("lt", b.apply("sin", c[0]), x[1]),
        lambda c: [b.apply("mul", c[0], b.apply("sin", c[0]))],
    )
    assert [line.strip() for line in lines_of(b, *left)] == [
        "double v1 = x[0];",
        "for (;;) {",
        "const double v2 = sin(v1);",
        "if (!(v2 < x[1])) {",
        "break;",
        "}",
        "v1 = v1 * v2;",
        "}",
        "",
        "y[0] = v1;",
    ]


@needs_a_compiler
def test_division_of_integers_has_a_result_for_every_pair(tmp_path):
    b = Builder()
    n, m = b.input("n", "i32", (4,)), b.input("m", "i32", (4,))
    for op in ("div", "rem"):
        b.output(op, "i32", np.array([b.apply(op, x, y) for x, y in zip(n, m, strict=True)], object))
    call = compiled(b.finish(), tmp_path, compiler=COMPILERS[0], flags=GUARDS)
    divided, rest = call([np.array([7, -(2**31), -7, -7]), np.array([0, -1, 2, -1])])
    assert divided.tolist() == [-1, -(2**31), -3, 7]
    assert rest.tolist() == [7, 0, -1, 0]


def test_small_functions_are_printed_only_where_they_are_called():
    b = Builder()
    (x, y), _ = named(b, 2)
    sum_of_both = statements(b.program, [("y", b.apply("add", x, y))], lambda k, e: f"x{k}")
    largest = statements(b.program, [("y", b.apply("max", x, y))], lambda k, e: f"x{k}")
    assert sum_of_both.helpers.names == []
    assert largest.helpers.names == ["larger"]


# ---- what lasts -----------------------------------------------------------------------------------------------------


def split(function, *args):
    """The statements for what lasts of the first argument alone, and those of the rest."""
    program = trace(function, *args)
    kept = lasting(program, {0})
    given = {value: f"workspace->kept{k}" for k, value in enumerate(kept)}
    read = lambda k, e: f"{'pxyz'[k]}[{e}]"  # noqa: E731
    outputs = [(f"out[{k}]", value) for k, value in enumerate(v for o in program.outputs for v in o.values)]
    first = statements(program, [(text, value) for value, text in given.items()], read)
    return "\n".join(first.lines), "\n".join(statements(program, outputs, read, given=given).lines)


def test_what_follows_from_parameters_is_computed_apart():
    derived, step = split(lambda p, x: jnp.exp(p[0]) * x + p[1] * 2.0, jnp.ones(2), jnp.ones(()))
    assert "exp(p[0])" in derived
    assert "exp" not in step
    assert "workspace->kept0" in step
    assert "2.0 * p[1]" in step, "a product is not worth a place in memory"


def test_what_follows_cheaply_from_what_is_kept_is_not_kept_too():
    derived, step = split(lambda p, x: (jnp.exp(p[0]) * x, 2.0 * jnp.exp(p[0]) + x), jnp.ones(2), jnp.ones(()))
    assert derived.count("workspace->") == 1
    assert "2.0 * workspace->kept0" in step


def test_what_follows_from_parameters_is_found_in_branches_and_loops_too():
    def law(p, x):
        inside = lambda: lax.fori_loop(0, 3, lambda i, a: a * jnp.exp(p[0]), x)  # noqa: E731
        return lax.cond(x > 0.0, inside, lambda: x)

    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "exp(p[0])" in derived
    assert "exp" not in step
    assert "x[" not in derived


def test_a_loop_over_parameters_alone_lasts():
    law = lambda p, x: x * lax.fori_loop(0, 30, lambda i, a: 0.5 * (a + p[1] / a), p[0])  # noqa: E731
    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "for (" in derived
    assert "for (" not in step


def test_a_loop_that_a_branch_keeps_from_going_on_for_ever_stays_in_it():
    def law(p, x):
        halved = lambda: lax.while_loop(lambda a: a > 1.0, lambda a: a * p[1], p[0])  # noqa: E731
        return lax.cond(x > 0.0, halved, lambda: x)

    derived, step = split(law, jnp.ones(2), jnp.ones(()))
    assert "while (" not in derived
    assert "while (" in step


def test_an_index_that_a_branch_guards_is_not_read_elsewhere():
    b = Builder()
    table = b.input("table", "f64", (3,))
    index, x = b.input("index", "i64", ())[()], b.input("x", "f64", ())[()]
    in_range = b.apply("lt", index, b.constant(3, "i64"))
    read = lambda: [b.apply("exp", b.apply("load", index, type="f64", data=0))]  # noqa: E731
    result = b.branch(in_range, read, lambda: [x])
    b.output("y", "f64", np.array(result, object))
    assert table.size == 3
    assert lasting(b.program, {0, 1}) == []


# ---- a whole law ----------------------------------------------------------------------------------------------------


def paper_law():
    scenario = scenarios.load("example-4.1")
    controller, state = scenario.controller, scenario.state0
    zero = jnp.zeros_like(state.q)
    reference = Reference(zero, zero, zero)
    memory = controller.init(jnp.zeros(()), state, reference)
    function = lambda c, t, state, reference, memory: c(t, state, reference, reference, memory)  # noqa: E731
    return function, (controller, jnp.zeros(()), state, reference, memory)


@needs_a_compiler
def test_the_law_of_the_paper_is_the_same_in_c(tmp_path):
    function, args = paper_law()
    call = compiled(trace(function, *args), tmp_path, compiler=COMPILERS[0])
    leaves, tree = jax.tree.flatten(args)
    random = np.random.default_rng(1)
    batch = [np.asarray(leaf) * random.uniform(0.8, 1.2, (50, *leaf.shape)) for leaf in leaves]
    theirs = jax.tree.leaves(jax.vmap(lambda *args: function(*tree.unflatten(args)))(*batch))
    for k in range(50):
        for ours, their in zip(call([leaf[k] for leaf in batch]), theirs, strict=True):
            np.testing.assert_allclose(ours, their[k], rtol=1e-12, atol=1e-13)


def test_the_law_of_the_paper_is_short_and_keeps_its_words():
    function, args = paper_law()
    text = function_text(trace(function, *args, names=["parameters", "t", "measured", "reference", "memory"]))
    assert text.count("\n") < 300
    assert max(len(line) for line in text.splitlines() if "void run" not in line) <= 110
    for word in ("e_1", "de_2", "eps1_1", "s_1", "s_2", "tau0_1", "u = "):
        assert word in text
    for comment in ("eq. (41)", "eq. (23)", "eq. (29)", "eqs. (45), (46)"):
        assert comment in text
    assert text.isascii()
