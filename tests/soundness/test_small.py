"""The small version of `scripts/measure soundness`: no certified bound is exceeded, no uncertifiable case accepted."""

import pytest

from tests.soundness import continuous, ratios, starts, warned
from tests.soundness.counted import Counted


def test_five_parts_of_the_printed_law_refuse_random_values_outside_their_ranges():
    count = Counted()
    starts.judged_parameters(1, 20, count)
    assert count.missed == 0 and count.refused == 100, count.notes


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
def test_simulated_arms_never_exceed_a_certified_bound(joints):
    for judge, numbers in (
        (continuous.judged_settling, (4, 100)),
        (continuous.judged_ultimate, (4, 100)),
        (starts.judged, (4, 500)),
        (ratios.judged, (2, 100)),
    ):
        count = Counted()
        judge(1, *numbers, joints, count)
        assert (count.exceeded, count.missed) == (0, 0), count.notes
        assert count.cases > 0


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
def test_the_monitor_warns_before_any_run_leaves_its_envelope_if_the_state_is_measured(joints):
    count = Counted()
    warned.judged(1, 2, 100, joints, count)
    assert count.missed == 0 and count.refused > 0
