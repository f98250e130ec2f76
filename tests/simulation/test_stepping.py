"""A `Stepping` can be passed as a whole, by keywords, or both."""

import jax
import numpy as np
import pytest

from slidax.core import semi_implicit_euler
from slidax.core.errors import DefinitionError
from slidax.simulation import Stepping, simulate, simulate_batch
from tests.architecture.test_architecture import in_a_fresh_interpreter
from tests.enrolled import assert_same_numbers
from tests.paper_examples import MOTION_4_1, START_4_1
from tests.simulation.simple import SMOOTH_PLANT, SPRING

LOOP = (SMOOTH_PLANT, SPRING, MOTION_4_1, START_4_1)
FINE = Stepping(period=0.02, substeps=4, integrator=semi_implicit_euler)


def test_a_stepping_and_its_fields_as_keywords_give_the_same_run():
    whole = simulate(*LOOP, t1=0.2, stepping=FINE)
    assert_same_numbers(whole, simulate(*LOOP, t1=0.2, period=0.02, substeps=4, integrator=semi_implicit_euler))
    coarse = simulate(*LOOP, t1=0.2, period=0.02)
    assert np.any(whole.state.q != coarse.state.q)
    assert_same_numbers(coarse, simulate(*LOOP, t1=0.2, stepping=Stepping(period=0.02)))


def test_a_keyword_overrides_the_field_of_the_stepping():
    changed = simulate(*LOOP, t1=0.2, stepping=Stepping(period=0.1, substeps=4), period=0.02, substeps=1)
    assert_same_numbers(changed, simulate(*LOOP, t1=0.2, period=0.02))


def test_a_batch_with_a_stepping_equals_the_single_run():
    def define(q):
        return SMOOTH_PLANT, SPRING, MOTION_4_1, type(START_4_1)(q, START_4_1.dq)

    runs = simulate_batch(define, START_4_1.q[None], t1=0.2, stepping=FINE, log_every=1)
    assert_same_numbers(runs[0].tally, simulate(*LOOP, t1=0.2, stepping=FINE).tally)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "`period`, the time between samples .* must be given"),
        ({"perod": 0.1}, "there is no argument `perod`; did you mean `period`?"),
    ],
)
def test_a_missing_period_and_an_unknown_argument_are_refused(change, message):
    with pytest.raises(DefinitionError, match=message):
        simulate(*LOOP, t1=0.2, **change)


def test_a_traced_period_is_refused():
    with pytest.raises(DefinitionError, match="`period` sets the number of samples"):
        jax.jit(lambda period: simulate(*LOOP, t1=0.2, period=period).state.q)(0.02)


def test_misspelled_options_of_a_stepping_are_refused():
    code = """
import jax
jax.config.update("jax_enable_x64", True)
import slidax as sx
for change in ({"mode": "contineous"}, {"outside": "go on"}, {"limits": "none"}, {"engine": "fast"}):
    try:
        sx.Stepping(period=1e-3, **change)
    except sx.DefinitionError as error:
        print(error)
"""
    assert in_a_fresh_interpreter(code).splitlines() == [
        "`Stepping.mode` must be one of `held`, `continuous`; got 'contineous'",
        "`Stepping.outside` must be one of `raise`, `recover`; got 'go on'",
        "`Stepping.limits` must be one of `check`, `ignore`; got 'none'",
        "`Stepping.engine` must be one of `auto`, `native`, `xla`, `cuda`; got 'fast'",
    ]
