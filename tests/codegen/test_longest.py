"""Upper bounds of the operations of a program."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.codegen import trace
from slidax.codegen.builder import Builder
from slidax.codegen.ir import Loop
from slidax.codegen.passes import FREE, count_iterations, count_operations

from . import interpreter


def halving(most, start=0, step=1, compared="lt"):
    """Halve a number while it is above 1, at most `most` times."""
    b = Builder()
    number, unit = b.input("x", "f64", ())[()], b.constant(1.0, "f64")
    count, by = b.constant(start, "i64"), b.constant(step, "i64")

    def goes_on(carried):
        return b.apply("and", b.apply("gt", carried[0], unit), b.apply(compared, carried[1], b.constant(most, "i64")))

    left = b.loop(
        [number, count],
        goes_on,
        lambda carried: [b.apply("mul", carried[0], b.constant(0.5, "f64")), b.apply("add", carried[1], by)],
    )
    b.output("y", "f64", np.array([left[0]], object))
    return b.finish()


def only_loop(program):
    return next(value for value in program.walk() if isinstance(value, Loop))


def test_loop_that_counts_up_to_a_constant_has_an_iteration_bound():
    program = halving(20)
    assert count_iterations(only_loop(program)) == 20
    assert count_iterations(only_loop(halving(20, start=5))) == 15
    # The condition has 3 operations and runs 21 times; the body has 2 operations and runs 20 times.
    assert count_operations(program).operations == 21 * 3 + 20 * 2
    assert count_operations(program).elementary == 0


@pytest.mark.parametrize("other", [{"step": 2}, {"step": 0}, {"step": -1}, {"compared": "gt"}])
def test_loop_without_a_unit_step_counter_has_no_iteration_bound(other):
    program = halving(20, **other)
    assert count_iterations(only_loop(program)) is None
    assert count_operations(program) is None


@pytest.mark.parametrize(("x", "turns_taken"), [(1e30, 20), (4.0, 2), (0.5, 0)])
def test_the_operation_count_is_that_of_the_longest_run(monkeypatch, x, turns_taken):
    computed, original = [], interpreter._Run.computed
    monkeypatch.setattr(interpreter._Run, "computed", lambda run, value: computed.append(value) or original(run, value))
    program = halving(20)
    (y,) = interpreter.interpreted(program, np.array([x]))
    assert y.item() == x * 0.5**turns_taken
    taken, most = sum(value.op not in FREE for value in computed), count_operations(program).operations
    assert taken == most - (20 - turns_taken) * 5


def test_operations_of_the_longer_branch_and_of_called_functions_count():
    b = Builder()
    x = b.input("x", "f64", ())[()]
    left = b.branch(
        b.apply("gt", x, b.constant(0.0, "f64")),
        lambda: [b.apply("exp", x)],
        lambda: [b.apply("mul", x, b.apply("add", x, b.constant(3.0, "f64")))],
    )
    b.output("y", "f64", np.array(left, object))
    # The comparison, the choice, and two operations or one elementary function.
    assert count_operations(b.finish()) == (4, 1)

    @jax.jit
    def within(x):
        return jnp.sin(x) + x

    program = trace(lambda x: within(within(x)), jnp.ones(()))
    assert count_operations(program) == (4, 2)
