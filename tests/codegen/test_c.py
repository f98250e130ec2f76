"""Generated C agrees with its program and compiles without a warning."""

import ctypes
import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.special
from jax import lax

from slidax.codegen import c_code, trace
from slidax.codegen.builder import Builder
from slidax.codegen.c.expressions import Dialect, Helpers

from .compiled_c import COMPILERS, GUARDS, STRICT, compiled, needs_a_compiler
from .random_programs import random_arrays, random_program
from .test_trace import EXACT, N, P, X, Y

WITH_NAN = X.at[0].set(jnp.nan)
DIVIDED = jnp.array([7, -7, -(2**63), 5])
EXTREME = jnp.array([jnp.nan, jnp.inf, -jnp.inf, 1e300, -1e300, 2.0**31, -(2.0**31) - 0.9, 2.0**63, -0.9, 2.9])


SHARED = ("sums and products", "integers", "unsigned", "roundings", "roots", "truths", "conversions", "bits", "choices")
COMPUTED = {
    **{name: EXACT[name] for name in SHARED},
    "division": lambda: (lambda n, m: (lax.div(n, m), lax.rem(n, m)), DIVIDED, jnp.array([2, 0, -1, -3])),
    "shifts": lambda: (lambda n, m: (n << m, n >> m, lax.shift_right_logical(n, m)), N, jnp.array([3, 63, 64])),
    "overflow": lambda: (lambda n: (n + n, n * n, -n, jnp.abs(n), n - 1), jnp.array([2**62, -(2**63), 2**63 - 1])),
    "extremes": lambda: (lambda x, y: (jnp.maximum(x, y), jnp.minimum(y, x), jnp.minimum(x, y)), WITH_NAN, Y),
    "to integers": lambda: (lambda x: (x.astype(jnp.int32), x.astype(jnp.int64), x.astype(jnp.uint32)), EXTREME),
    "to unsigned": lambda: (lambda x: x.astype(jnp.uint64), EXTREME),
    "bits back": lambda: (lambda n: lax.bitcast_convert_type(n, jnp.float64), jnp.array([0x3FF8000000000000])),
    "finite": lambda: (lambda x: (jnp.isfinite(x), jnp.isnan(x), x != x), EXTREME),
    "a table": lambda: (lambda t, i: (t[i], t[i + 90]), jnp.arange(80.0), 17),
    "a loop": lambda: (lambda x: lax.fori_loop(0, 5, lambda i, a: a * 0.5 + i, x), X),
    "a swap": lambda: (lambda x, y: lax.fori_loop(0, 3, lambda i, a: (a[1], a[0] + a[1]), (x, y)), X, Y),
    "a while": lambda: (lambda x: lax.while_loop(lambda a: jnp.all(a < 9.0), lambda a: a * a + 1.1, x), X),
    "a while whose condition and body share a sum": lambda: (
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
    """Return a function that computes the results of several cases, and its arguments."""
    cases = {name: CASES[name]() for name in names}

    def everything(args):
        return {name: cases[name][0](*args[name]) for name in names}

    return everything, {name: list(cases[name][1:]) for name in names}


def results(names, folder, **options):
    """Results of C and of JAX for some cases, by name."""
    function, args = all_at_once(names)
    call = compiled(trace(function, args), folder, **options)
    theirs = jax.jit(function)(args)
    ours = call([np.asarray(leaf) for leaf in jax.tree.leaves(args)])
    return jax.tree.unflatten(jax.tree.structure(theirs), ours), theirs


def assert_close(ours, theirs, **tolerance):
    for ours_k, theirs_k in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(ours_k, theirs_k, **tolerance)


@pytest.fixture(scope="module")
def in_c(tmp_path_factory):
    return results(CASES, tmp_path_factory.mktemp("c"), compiler=COMPILERS[0], flags=GUARDS)


@needs_a_compiler
@pytest.mark.parametrize("name", COMPUTED)
def test_generated_c_agrees_with_jax(name, in_c):
    ours, theirs = in_c
    assert_close(ours[name], theirs[name], rtol=4e-16, atol=0)


@needs_a_compiler
@pytest.mark.parametrize("name", ELEMENTARY)
def test_elementary_functions_in_generated_c_agree_with_jax(name, in_c):
    ours, theirs = in_c
    assert_close(ours[name], theirs[name], rtol=4e-15, atol=0)


@pytest.mark.skipif("clang" not in COMPILERS, reason="clang is not installed")
def test_generated_c_agrees_between_two_compilers(in_c, tmp_path):
    ours, _ = results(CASES, tmp_path, compiler="clang")
    assert_close(ours, in_c[0], rtol=1e-15, atol=0)


@needs_a_compiler
def test_c_in_single_precision_has_no_double_and_agrees_with_jax(tmp_path):
    names = [name for name in CASES if name not in BITS]
    function, args = all_at_once(names)
    assert "double" not in c_code(trace(function, args), real="float")
    ours, theirs = results(names, tmp_path, compiler=COMPILERS[-1], real="float")
    assert_close(ours["powers"], theirs["powers"], rtol=1e-6)
    assert_close(ours["angles"], theirs["angles"], rtol=1e-6)


@needs_a_compiler
def test_the_inverse_error_function_is_accurate_to_both_ends(tmp_path):
    x = np.array([0.0, 1e-300, 1e-9, -0.3, 0.4999, 0.5, 0.97, 1 - 1e-9, -1 + 1e-16, 1.0, -1.0, 2.0, np.nan])
    ours = compiled(trace(lax.erf_inv, jnp.asarray(x)), tmp_path, compiler=COMPILERS[0], flags=GUARDS)([x])
    np.testing.assert_allclose(ours[0], scipy.special.erfinv(x), rtol=1e-14, atol=0)


@needs_a_compiler
def test_random_programs_in_c_give_the_same_bits_as_llvm_code(tmp_path):
    llvm = pytest.importorskip("slidax.codegen.llvm")
    pytest.importorskip("llvmlite")
    from slidax.codegen.llvm.vectorise import lower_and_fuse

    for seed in (5, 7, 10, 12, 19, 22):
        program = random_program(seed)
        folder = tmp_path / str(seed)
        folder.mkdir()
        guards = GUARDS if seed % 2 == 0 else []
        ours = compiled(lower_and_fuse(program), folder, compiler=COMPILERS[(seed % 2) % len(COMPILERS)], flags=guards)
        theirs = llvm.compile(program)
        for arrays in map(random_arrays, range(4)):
            for ours_k, theirs_k in zip(ours(arrays), theirs(arrays), strict=True):
                np.testing.assert_array_equal(ours_k, theirs_k, err_msg=f"seed {seed}")


@needs_a_compiler
def test_integer_division_is_defined_for_zero_and_overflow(tmp_path):
    b = Builder()
    n, m = b.input("n", "i32", (4,)), b.input("m", "i32", (4,))
    for op in ("div", "rem"):
        b.output(op, "i32", np.array([b.apply(op, x, y) for x, y in zip(n, m, strict=True)], object))
    call = compiled(b.finish(), tmp_path, compiler=COMPILERS[0], flags=GUARDS)
    divided, rest = call([np.array([7, -(2**31), -7, -7]), np.array([0, -1, 2, -1])])
    assert divided.tolist() == [-1, -(2**31), -3, 7]
    assert rest.tolist() == [7, 0, -1, 0]


@needs_a_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_finiteness_check_detects_one_bad_number_among_many(tmp_path, real):
    helpers = Helpers(Dialect(real=real))
    name = helpers.name_of("all_finite", "f64")
    wrapper = (
        f"bool every(const {real} *x, size_t n);\nbool every(const {real} *x, size_t n)\n{{ return {name}(x, n); }}\n"
    )
    heads = "".join(f"#include <{head}.h>\n" for head in ("math", "stdbool", "stddef"))
    file, library = tmp_path / "every.c", tmp_path / "every.so"
    file.write_text(heads + "\n".join(helpers.lines) + wrapper)
    flags = [*STRICT, "-O2", "-fPIC", "-shared", *GUARDS]
    subprocess.run([COMPILERS[0], *flags, str(file), "-o", str(library), "-lm"], check=True)
    every = ctypes.CDLL(str(library)).every
    every.restype, every.argtypes = ctypes.c_bool, [ctypes.c_void_p, ctypes.c_size_t]
    # A sum of these numbers themselves would be infinite.
    most = np.finfo(np.float32 if real == "float" else np.float64).max
    for size in (7, 8, 30):
        for k in range(size):
            x = np.full(size, most, np.float32 if real == "float" else np.float64)
            assert every(x.ctypes.data, size)
            for wrong in (np.nan, np.inf, -np.inf):
                x[k] = wrong
                assert not every(x.ctypes.data, size)
