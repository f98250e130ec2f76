import ctypes

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.codegen import c_code, trace
from slidax.export.programs import float_constant, with_float_constants
from slidax.law import EnvelopeFrame, Sides
from slidax.law.implicit_steps import ROUNDING, Barrier
from tests.codegen.compiled_c import needs_a_compiler
from tests.export.exported import compiled
from tests.law.members import SURFACES

pytestmark = needs_a_compiler

FLOAT = 2.0**-23
CASES = 20_000
NEAR = 10
"""Largest number of iterations from a guess within a tenth."""

FAR = 20
"""Largest number of iterations from any guess."""


def barrier(surface, now, upper, horizon):
    sides = Sides(lower=-jnp.ones(2), upper=jnp.broadcast_to(upper, (2,)))
    return Barrier(EnvelopeFrame(now=now, ahead=now, sides=sides), surface, horizon)


def in_c(function, arguments, folder, real):
    program = trace(function, *arguments)
    lines = c_code(with_float_constants(program) if real == "float" else program, real=real).splitlines()
    counted = [part for item in lines for part in ([item, "++turns;"] if item.strip() == "for (;;) {" else [item])]
    (folder / f"{real}.c").write_text("long turns;\n" + "\n".join(counted) + "\n")
    compiled("gcc", folder, f"{real}.c", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-o", f"{real}.so", "-lm")
    library = ctypes.CDLL(str(folder / f"{real}.so"))
    turns = ctypes.c_long.in_dll(library, "turns")
    dtype = np.float32 if real == "float" else np.float64

    def call(*values):
        left = [np.zeros(2, dtype) for _ in program.outputs]
        arrays = [np.ascontiguousarray(item, dtype) for item in values]
        turns.value = 0
        library.run(*[ctypes.c_void_p(item.ctypes.data) for item in (*arrays, *left)])
        return left, turns.value

    return call


def cases(seed):
    rng = np.random.default_rng(seed)
    for _ in range(CASES):
        now = 10.0 ** rng.uniform(-3, 0, 2)
        eps = rng.normal(size=2) * 10.0 ** rng.uniform(-4, 0.7)
        yield now, rng.uniform(0.1, 1.0), 10.0 ** rng.uniform(-3, -1.3), eps, rng


@pytest.mark.full
@pytest.mark.parametrize(("name", "surface"), SURFACES, ids=[name for name, _ in SURFACES])
def test_the_root_search_in_single_precision_converges_within_20_iterations(name, surface, tmp_path):
    def value(now, upper, horizon, eps):
        return barrier(surface, now, upper, horizon).value_and_slope(eps)[0]

    def solve(now, upper, horizon, target, guess):
        sought = barrier(surface, now, upper, horizon)
        return sought.solve(target, guess, sought.value_and_slope(guess))

    two, item = jnp.ones(2), jnp.asarray(0.5)
    exact = in_c(value, (two, item, item, two), tmp_path, "double")
    rounded = in_c(value, (two, item, item, two), tmp_path, "float")
    (tmp_path / "search").mkdir()
    search = in_c(solve, (two, item, item, two, two), tmp_path / "search", "float")
    worst, near, far = 0.0, 0, 0
    for now, upper, horizon, eps, rng in cases(3):
        now, upper, horizon, eps = (np.float32(item) for item in (now, upper, horizon, eps))
        (target,), _ = exact(now, upper, horizon, eps)
        (computed,), _ = rounded(now, upper, horizon, eps)
        worst = max(worst, float(np.max(np.abs(computed - target) / np.abs(target))) / FLOAT)
        wanted = np.float32(target)
        for guess, is_near in ((eps * (1.0 + 0.1 * rng.normal(size=2)), True), (rng.normal(size=2) * 3.0, False)):
            (result,), turns = search(now, upper, horizon, wanted, np.float32(guess))
            (there,), _ = exact(now, upper, horizon, result)
            assert np.all(np.abs(there - wanted) <= 16 * FLOAT * (np.abs(wanted) + horizon))
            near, far = (max(near, turns), far) if is_near else (near, max(far, turns))
    print(f"\n{name}: rounding {worst:.1f} units, {near} turns, {far} from anywhere")
    # The tolerance of the search exceeds the rounding error of the sum.
    assert worst <= float_constant(ROUNDING) / FLOAT and near <= NEAR and far <= FAR
