"""The named cause is the one that was put in, and its remedy makes the run hold."""

from __future__ import annotations

import pytest

from slidax.analysis import explain

from .seeded import SEEDED, seeded

QUICK = ["too light a model", "too heavy a model", "robust torque", "coarse encoder"]


# A bound that is far too small is what one of them is about.
pytestmark = pytest.mark.filterwarnings("ignore:scheme.bound")


def require_named(which: str) -> None:
    scenario = seeded(which)
    run = scenario.simulate(log_every=1)
    assert not run.outcome.ok
    first = explain(scenario, run)[0]
    assert (first.finding.name, first.tried, first.holds) == (SEEDED[which][2], True, True), first.sentence()


@pytest.mark.parametrize("which", QUICK)
def test_cause_of_a_seeded_fault_is_named_and_its_remedy_holds(which: str) -> None:
    require_named(which)


@pytest.mark.full
@pytest.mark.parametrize("which", sorted(SEEDED.keys() - set(QUICK)))
def test_causes_of_all_other_seeded_faults_are_named_and_remedied(which: str) -> None:
    require_named(which)
