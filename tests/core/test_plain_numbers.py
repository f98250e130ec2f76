"""Lists, whole numbers and plain floats are taken wherever arrays are, and change nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import Reference, State
from tests.architecture.test_architecture import in_a_fresh_interpreter


@pytest.mark.parametrize("q", [[0, 1], (0.0, 1.0), np.array([0, 1]), jnp.array([0, 1]), jnp.array([0.0, 1.0])])
def test_a_state_is_made_of_anything_like_numbers_and_is_at_rest_unless_told(q):
    state = State(q)
    assert isinstance(state.q, jax.Array) and state.q.dtype == state.dq.dtype == np.float64
    np.testing.assert_array_equal(state.q, [0.0, 1.0])
    np.testing.assert_array_equal(state.dq, [0.0, 0.0])
    np.testing.assert_array_equal(State(q=q, dq=[1, 2]).dq, [1.0, 2.0])


def test_so_is_a_reference():
    still = Reference([1, 2])
    np.testing.assert_array_equal(still.dq, [0.0, 0.0])
    np.testing.assert_array_equal(Reference([1, 2], [3, 4], (5, 6)).ddq, [5.0, 6.0])
    np.testing.assert_array_equal(still.ddq, [0.0, 0.0])


def test_what_is_no_number_is_refused():
    with pytest.raises(DefinitionError, match="a number or a list of numbers is needed; got"):
        State([[1.0], [2.0, 3.0]])


def test_it_costs_no_operation_in_traced_code():
    jaxpr = jax.make_jaxpr(lambda q, dq: State(q, dq))(jnp.zeros(2), jnp.zeros(2))
    assert not jaxpr.eqns


LAWS = [("example-4.1", name) for name in ("cftsmppc", "slotine_li_ppc", "super_twisting", "computed_torque")]


# Each is computed operation by operation, which takes long the first time.
@pytest.mark.parametrize(
    "loads", [LAWS[2:], pytest.param([*LAWS, ("example-4.1-1khz", "cftsmppc")], marks=pytest.mark.full)]
)
def test_every_law_takes_a_plain_time_and_answers_alike(loads):
    """In an interpreter of its own: there the types of arguments are not checked."""
    code = f"""
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp, numpy as np, slidax as sx
for scenario, scheme in {loads}:
    made = sx.scenarios.load(scenario, {{"scheme.name": scheme}})
    law, start = made.controller, made.state0
    for t in (0, 0.25):
        exact = jnp.asarray(float(t))
        now, same = made.trajectory.reference(t), made.trajectory.reference(exact)
        plain = law(t, start, now, now, law.init(t, start, now))
        array = law(exact, start, same, same, law.init(exact, start, same))
        for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(array), strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
print("alike")
"""
    assert in_a_fresh_interpreter(code).strip() == "alike"
