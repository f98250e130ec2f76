"""Lists, integers and Python floats are accepted in place of arrays, with the same results."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State, Timing
from tests.architecture.test_architecture import in_a_fresh_interpreter


@pytest.mark.parametrize("q", [[0, 1], (0.0, 1.0), np.array([0, 1]), jnp.array([0, 1]), jnp.array([0.0, 1.0])])
def test_state_and_reference_accept_array_likes_and_default_to_rest(q):
    state, still = State(q), Reference(q)
    assert isinstance(state.q, jax.Array) and state.q.dtype == state.dq.dtype == np.float64
    np.testing.assert_array_equal([state.q, state.dq, State(q=q, dq=[1, 2]).dq], [[0, 1], [0, 0], [1, 2]])
    np.testing.assert_array_equal([still.dq, still.ddq, Reference(q, [3, 4], (5, 6)).ddq], [[0, 0], [0, 0], [5, 6]])


def test_constructing_a_state_adds_no_operation_to_traced_code():
    jaxpr = jax.make_jaxpr(lambda q, dq: State(q, dq))(jnp.zeros(2), jnp.zeros(2))
    assert not jaxpr.eqns


LAWS = [("example-4.1", name) for name in ("cftsmppc", "slotine_li_ppc", "super_twisting", "computed_torque")]


# Without jit, each operation is compiled separately, which takes long the first time.
@pytest.mark.parametrize(
    "loads", [LAWS[2:], pytest.param([*LAWS, ("example-4.1-1khz", "cftsmppc")], marks=pytest.mark.full)]
)
def test_laws_accept_a_python_float_as_time(loads):
    """In a fresh interpreter, where argument types are not checked."""
    code = f"""
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp, numpy as np, slidax as sx
for scenario, scheme in {loads}:
    loop = sx.scenarios.load(scenario, {{"scheme.name": scheme}})
    law, start = loop.controller, loop.state0
    for t in (0, 0.25):
        exact = jnp.asarray(float(t))
        now, same = loop.trajectory.reference(t), loop.trajectory.reference(exact)
        plain = law(t, start, now, now, law.init(t, start, now))
        array = law(exact, start, same, same, law.init(exact, start, same))
        for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(array), strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
print("alike")
"""
    assert in_a_fresh_interpreter(code).strip() == "alike"


@pytest.mark.parametrize(("delay", "dead_time", "whole"), [(1.0, 2.0, 3), (1.0, 0.25, 1), (0.0, 1.75, 2)])
def test_total_delay_adds_the_dead_time_and_rounds_to_whole_periods(delay, dead_time, whole):
    timing = Timing(1e-3, delay, dead_time)
    assert timing.total_delay == delay + dead_time
    assert timing.whole_periods == whole
