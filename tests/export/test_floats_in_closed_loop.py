"""A law in floats holds its envelope on an arm in doubles."""

from __future__ import annotations

import pytest

from slidax.export.status import ENVELOPE_LEFT, HELD, PROMISE_VOID
from slidax.scenarios import load

from .closed_loop import closed_loop
from .exported import needs_a_compiler

pytestmark = needs_a_compiler

SCENARIOS = [
    "example-4.1-1khz",
    *(pytest.param(name, marks=pytest.mark.full) for name in ("example-4.2-1khz", "panda-payload", "ur5e-payload")),
]


@pytest.mark.parametrize("name", SCENARIOS)
def test_the_envelope_is_held_to_the_end(name, tmp_path):
    scenario = load(name)
    single = closed_loop(scenario, tmp_path / "floats", single=True)
    assert not single.status & (HELD | ENVELOPE_LEFT.bit | PROMISE_VOID.bit)
    double = closed_loop(scenario, tmp_path / "doubles", single=False)
    assert single.status == double.status
    assert single.steady < 2.0 * double.steady + 1e-6
    # As many turns as any search took in any step of either; `pytest -s` shows how often.
    print(f"\n{name}\n  doubles {double.steady:.3g} {double.turns}\n  floats {single.steady:.3g} {single.turns}")
    assert max(most for turns in double.turns for most in turns) <= 12
    assert max(most for turns in single.turns for most in turns) <= 12
