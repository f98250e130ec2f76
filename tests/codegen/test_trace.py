"""Traced programs compute the results of JAX: all primitives, loops, branches, indices and random numbers."""

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from slidax.codegen import llvm, trace
from slidax.codegen.ir import Branch, Loop

X = jnp.array([0.3, -1.7, 2.5])
Y = jnp.array([1.1, 0.4, -0.6])
P = jnp.abs(Y) + 0.1
N = jnp.array([4, -7, 3])
A = jnp.arange(12.0).reshape(3, 4) - 5.0
B = X > 0


def computed(function, *args):
    """Return the function's results from generated machine code and from JAX."""
    program = trace(function, *args)
    ours = llvm.compile(program)([np.asarray(leaf) for leaf in jax.tree.leaves(args)])
    theirs = [np.asarray(leaf) for leaf in jax.tree.leaves(jax.jit(function)(*args))]
    return ours, theirs


def assert_alike(function, *args, rtol=4e-16):
    ours, theirs = computed(function, *args)
    assert len(ours) == len(theirs) > 0
    for mine, their in zip(ours, theirs, strict=True):
        assert mine.shape == their.shape
        assert mine.dtype == their.dtype
        if their.dtype.kind == "f":
            np.testing.assert_allclose(mine, their, rtol=rtol, atol=0.0)
        else:
            np.testing.assert_array_equal(mine, their)


EXACT = {
    "sums and products": lambda: (lambda x, y: (x + y, x - y, x * y, x / y, -x, jnp.abs(x)), X, Y),
    "integers": lambda: (lambda n: (n + 2, n * 3, n // 2, n % 3, -n, jnp.abs(n), n & 5, n | 8, n ^ 3, ~n), N),
    "shifts": lambda: (lambda n: (n << 3, n >> 1, lax.shift_right_logical(n, jnp.array([1, 2, 3]))), N),
    "unsigned": lambda: (lambda n: (n.astype(jnp.uint32) * 3, n.astype(jnp.uint64) >> 5), N),
    "largest and smallest": lambda: (lambda x, y: (jnp.maximum(x, y), jnp.minimum(x, y), jnp.clip(x, -1.0, 1.0)), X, Y),
    "roundings": lambda: (lambda x: (jnp.floor(x), jnp.ceil(x), jnp.round(x), lax.round(x), jnp.sign(x)), X * 2),
    "roots": lambda: (lambda x: (jnp.sqrt(x), x**2, x**3, x**-2, jnp.square(x)), P),
    "remainders": lambda: (lambda x, y: (lax.rem(x, y), x % y), X, Y),
    "comparisons": lambda: (lambda x, y: (x < y, x <= y, x > y, x >= y, x == y, x != y, jnp.isfinite(x)), X, Y),
    "truths": lambda: (lambda b: (b & True, b | ~b, b ^ True, jnp.any(b), jnp.all(b), b.astype(float), b < True), B),
    "conversions": lambda: (lambda x, n: (x.astype(int), n.astype(float), (x > 1).astype(int), n.astype(bool)), X, N),
    "conversions out of range": lambda: (lambda x: x.astype(jnp.int32), jnp.array([1e300, -jnp.inf, jnp.nan, -2.9])),
    "bits": lambda: (lambda x: lax.bitcast_convert_type(x, jnp.uint64), X),
    "choices": lambda: (lambda b, x, y: (jnp.where(b, x, y), jnp.where(b, x, 0.0)), B, X, Y),
    "shapes": lambda: (lambda a: (a.T, a.reshape(2, 6), a[1], a[::2, 1:3], a[None], jnp.flip(a, 1), a.ravel()), A),
    "joining": lambda: (lambda x, a: (jnp.concatenate([x, x]), jnp.stack([x, x]), jnp.pad(a, ((1, 0), (0, 2)))), X, A),
    "unpadding": lambda: (lambda a: lax.pad(a, 7.0, ((-1, 2, 1), (1, -1, 0))), A),
    "splitting": lambda: (lambda a: jnp.split(a, 2, axis=1), A),
    "broadcasting": lambda: (lambda x, a: (x[:, None] * a, jnp.broadcast_to(x, (2, 3)), jnp.zeros((2, 2))), X, A),
    "largest of all": lambda: (lambda a: (jnp.max(a), jnp.min(a, 0), jnp.argmax(a, 1), jnp.argmin(a)), A),
    "first that is true": lambda: (lambda b: (jnp.argmax(b), jnp.argmin(b)), jnp.array([False, True, True])),
    "largest with NaN": lambda: (lambda x: (jnp.argmax(x), jnp.max(x)), jnp.array([1.0, jnp.nan, 3.0])),
    "counting": lambda: (lambda: (jnp.arange(4), jnp.arange(4.0), jnp.eye(3)),),
    "running sums": lambda: (lambda n: (jnp.cumsum(n), jnp.cumprod(n), lax.cummax(n), lax.cumsum(n, reverse=True)), N),
    "static index": lambda: (lambda x, a: (x[jnp.array([2, 0])], a[1, 2], x[-1], a[:, jnp.array([0, 3])]), X, A),
    "index": lambda: (lambda x, a, i: (x[i], a[i], a[:, i], a[i, i], x[i - 5]), X, A, jnp.array(1)),
    "index out of range": lambda: (lambda x, i: (x[i], x[-i], x.at[i].get(mode="fill"), x.at[i].set(9.0)), X, 7),
    "many indices": lambda: (lambda a, n: (a[n], a[n, n + 1]), A, jnp.array([2, 0])),
    "window": lambda: (lambda x, i: (lax.dynamic_slice(x, (i,), (2,)), lax.dynamic_slice(x, (i + 9,), (2,))), X, 1),
    "window in two axes": lambda: (lambda a, i: lax.dynamic_slice(a, (i, i + 1), (2, 2)), A, 1),
    "replacing": lambda: (lambda x, a, i: (x.at[i].set(5.0), a.at[i].set(1.0), a.at[:, i].set(2.0)), X, A, 2),
    "replacing a window": lambda: (lambda a, i: lax.dynamic_update_slice(a, jnp.ones((2, 2)), (i, i)), A, 1),
    "adding in place": lambda: (lambda x, n: (x.at[n].add(1.0), x.at[n].multiply(2.0), x.at[0].max(9.0)), X, N % 3),
    "a long table": lambda: (
        lambda table, i: (table[i], table[i + 90], table[:, 1][i]),
        jnp.arange(80.0).reshape(40, 2),
        17,
    ),
    "the table's ends": lambda: (lambda table, i: table[i], jnp.arange(80.0).reshape(40, 2), 99),
    "searching": lambda: (lambda x, v: jnp.searchsorted(x, v), jnp.arange(9.0), jnp.array(4.0)),
    "searching from the right": lambda: (lambda x: jnp.searchsorted(x, 4.0, side="right"), jnp.arange(9.0)),
    "searching a long table": lambda: (lambda x, v: jnp.searchsorted(x, v), jnp.arange(99.0), jnp.array(71.5)),
    "vmap": lambda: (lambda a: jax.vmap(lambda row: row * row[0])(a), A),
    "slope of tanh": lambda: (lambda x: jax.jvp(jnp.tanh, (x,), (jnp.ones_like(x),))[1] / jnp.tanh(x) ** 0, X * 0.0),
    "derivative": lambda: (lambda x: jax.jvp(lambda x: x * x * x, (x,), (jnp.ones_like(x),)), X),
}


@pytest.mark.parametrize("name", EXACT)
def test_operations_rounded_once_have_the_bits_of_jax(name):
    function, *args = EXACT[name]()
    assert_alike(function, *args, rtol=0.0)


ROUNDED = {
    "sums": lambda: (lambda a: (jnp.sum(a), jnp.sum(a, 0), jnp.mean(a), jnp.prod(a, 1), jnp.linalg.norm(a)), A + 0.1),
    "products of matrices": lambda: (lambda a, x: (a.T @ x, a @ a.T, jnp.einsum("ij,ij->i", a, a), x @ x), A, X),
    "exponentials": lambda: (lambda x: (jnp.exp(x), jnp.expm1(x), jnp.log(P), jnp.log1p(P), jnp.exp2(x)), X),
    "powers": lambda: (lambda x, y: (x**y, x**1.2, x**0.5, 2.0**y, lax.rsqrt(x), jnp.cbrt(x)), P, Y),
    "circular functions": lambda: (lambda x: (jnp.sin(x), jnp.cos(x), jnp.tan(x), jnp.arctan2(x, Y), jnp.arctan(x)), X),
    "their inverses": lambda: (lambda x: (jnp.arcsin(x), jnp.arccos(x)), Y / 2),
    "hyperbolic functions": lambda: (lambda x: (jnp.sinh(x), jnp.cosh(x), jnp.tanh(x), jax.nn.sigmoid(x)), X),
    "error functions": lambda: (lambda x: (jax.scipy.special.erf(x), jax.scipy.special.erfinv(x)), Y / 2),
}


@pytest.mark.parametrize("name", ROUNDED)
def test_operations_with_repeated_rounding_agree_with_jax_to_3e_15(name):
    function, *args = ROUNDED[name]()
    assert_alike(function, *args, rtol=3e-15)


def test_random_numbers_are_those_of_jax():
    def draws(seed, k):
        key = jax.random.fold_in(jax.random.key(seed), k)
        left, right = jax.random.split(key)
        bits = jax.random.bits(left, (3,), jnp.uint32)
        return jax.random.uniform(key, (5,)), jax.random.normal(right, (2, 2)), bits, jax.random.randint(key, (), 0, 9)

    for seed in (0, 3, 2**33 + 5):
        assert_alike(draws, jnp.array(seed), jnp.array(11), rtol=1e-13)


def newton(f, x):
    return lax.fori_loop(0, 30, lambda _, x: x - f(x) / jax.jvp(f, (x,), (jnp.ones_like(x),))[1], x)


def cubic_root(a):
    return lax.custom_root(lambda x: x**3 + x - a, a, newton, lambda g, y: y / g(jnp.ones_like(y)))


def root_and_steps(a):
    def solve(f, x):
        return newton(f, x), {"steps": jnp.array(30), "residual": f(newton(f, x))}

    return lax.custom_root(lambda x: x**3 + x - a, a, solve, lambda g, y: y / g(jnp.ones_like(y)), has_aux=True)


def by_the_diagonal(a):
    matrix = jnp.diag(a)
    return lax.custom_linear_solve(lambda x: matrix @ x, a + 1.0, lambda _, b: b / jnp.diag(matrix), symmetric=True)


SOLVED = {
    "a root": lambda: (cubic_root, X[0]),
    "a root with auxiliary outputs": lambda: (root_and_steps, X[0]),
    "roots side by side": lambda: (jax.vmap(cubic_root), X),
    "the derivative of a root": lambda: (jax.grad(cubic_root), X[0]),
    "the derivatives of roots": lambda: (lambda x: jax.jvp(jax.vmap(cubic_root), (x,), (Y,)), X),
    "a root in a loop": lambda: (lambda x: lax.fori_loop(0, 3, lambda _, x: cubic_root(x), x), X[0]),
    "a linear system": lambda: (by_the_diagonal, P),
    "the derivative of its solution": lambda: (lambda x: jax.jvp(by_the_diagonal, (x,), (Y,)), P),
    "a version for each platform": lambda: (
        lambda x: (
            lax.platform_dependent(x, cpu=jnp.sin, default=jnp.cos),
            lax.platform_dependent(x, tpu=jnp.sin, default=jnp.cos),
        ),
        X,
    ),
}


@pytest.mark.parametrize("name", SOLVED)
def test_custom_solvers_in_traced_functions_agree_with_jax(name):
    function, *args = SOLVED[name]()
    assert_alike(function, *args, rtol=3e-15)


def blocks(program, kind):
    return [value for value in program.walk() if isinstance(value, kind)]


def test_a_scan_stays_a_loop_and_returns_its_carry():
    def function(x, rows):
        return lax.scan(lambda c, row: (c * row[0] + row[1], None), x, rows)[0]

    assert_alike(function, X[0], A)
    (loop,) = blocks(trace(function, X[0], A), Loop)
    assert loop.iterations.data == 3


def test_a_scan_stacks_its_outputs_forwards_and_backwards():
    for reverse in (False, True):
        assert_alike(
            lambda x, r=reverse: lax.scan(lambda c, i: (c + i, (c * i, i)), x, jnp.arange(5), reverse=r), jnp.array(2)
        )


def test_a_scan_with_many_outputs_is_unrolled():
    function = lambda x: lax.scan(lambda c, i: (c + 1.0, c * X), x, jnp.arange(30))[1]  # noqa: E731
    assert_alike(function, X[0])
    assert not blocks(trace(function, X[0]), Loop)


def test_a_loop_without_iterations_returns_its_initial_values():
    assert_alike(lambda x: lax.fori_loop(0, 0, lambda i, c: c + 1.0, x), X[0])
    assert_alike(lambda x, n: lax.fori_loop(0, n, lambda i, c: c + 1.0, x), X[0], jnp.array(-3))


def test_a_while_loop_has_the_iterations_of_jax():
    def root(x):
        return lax.while_loop(
            lambda c: jnp.abs(c[0] * c[0] - x) > 1e-12, lambda c: (0.5 * (c[0] + x / c[0]), c[1] + 1), (x, 0)
        )

    for x in (2.0, 1e6, 1.0):
        assert_alike(root, jnp.array(x))


def test_nested_loops_agree_with_jax():
    def function(x):
        return lax.fori_loop(0, 4, lambda i, c: lax.fori_loop(0, i, lambda j, d: d + i * j, c * 2.0), x)

    assert_alike(function, X[0])


def test_loop_invariants_are_computed_before_the_loop():
    program = trace(lambda x, y: lax.fori_loop(0, 9, lambda i, c: c * jnp.exp(y), x), X[0], Y[0])
    (exponential,) = [value for value in program.walk() if value.op == "exp"]
    assert exponential.region is program.body


@pytest.mark.parametrize("x", [-1.0, 0.5, 3.0])
def test_a_branch_stays_a_branch_and_takes_the_correct_side(x):
    function = lambda x: lax.cond(x > 0, lambda: (jnp.exp(x), 1), lambda: (x, 2))  # noqa: E731
    assert_alike(function, jnp.array(x), rtol=4e-16)
    program = trace(function, jnp.array(x))
    (branch,) = blocks(program, Branch)
    (exponential,) = [value for value in program.walk() if value.op == "exp"]
    assert exponential.region in (branch.then, branch.otherwise)


@pytest.mark.parametrize("which", [-4, 0, 1, 2, 9])
def test_switch_clamps_its_index_to_the_nearest_case(which):
    cases = [lambda x: x, lambda x: x * 2.0, lambda x: x * x]
    assert_alike(lambda i, x: lax.switch(i, cases, x), jnp.array(which), X)


def test_common_subexpressions_are_computed_once():
    program = trace(lambda x, y: jnp.sin(x * y) + jnp.cos(1.0 + y * x) * jnp.sin(x * y), X[0], Y[0])
    assert sum(value.op == "mul" for value in program.walk()) == 2
    assert sum(value.op == "sin" for value in program.walk()) == 1


def test_constants_are_folded_and_unused_values_removed():
    def function(x):
        unused = jnp.exp(x)
        del unused
        return x * (jnp.arange(3.0)[1] * 2.0 - 1.0) + 0.0

    values = list(trace(function, X[0]).walk())
    assert [value.op for value in values] == ["input"]


def test_inputs_and_outputs_are_named_by_their_paths():
    program = trace(lambda a, b: {"sum": a["x"] + b, "both": (b, b)}, {"x": X}, Y, names=("first", "second"))
    assert [entry.name for entry in program.inputs] == ["first.x", "second"]
    assert [output.name for output in program.outputs] == ["both.0", "both.1", "sum"]


def test_a_value_has_its_source_location():
    def scaled(x):
        doubled = 2.0 * x
        return jnp.sin(doubled)

    program = trace(scaled, X)
    (origin, *_) = [value.origin for value in program.walk() if value.op == "mul"]
    assert origin.frames[0].file == __file__
    assert "scaled" in origin.frames[0].function
    assert (origin.element, origin.shape) == (0, (3,))


def test_a_nested_branch_on_the_same_condition_is_removed():
    def function(x):
        far = x > 1.0
        return lax.cond(far, lambda: lax.cond(far, lambda: jnp.exp(x), lambda: jnp.log(x)), lambda: x)

    for x in (0.5, 2.0):
        assert_alike(function, jnp.array(x))
    program = trace(function, X[0])
    assert len(blocks(program, Branch)) == 1
    assert not [value for value in program.walk() if value.op == "log"]


def test_the_documented_native_example_computes_the_torques_of_its_law():
    text = (Path(__file__).parents[2] / "docs" / "native.md").read_text()
    (example,) = re.findall(r"```python\n(import jax.numpy.*?)```", text, re.DOTALL)
    names = {}
    exec(example, names)
    np.testing.assert_allclose(names["tau"], -2.0 * np.sin([0.1, 0.2]), rtol=1e-15)
