"""The small version of `scripts/measure soundness`: no certified bound is exceeded, no uncertifiable case accepted."""

import numpy as np
import pytest

from tests.soundness import along_time, continuous, ratios, starts, warned
from tests.soundness.counted import Counted
from tests.soundness.loops import KINDS, judged


@pytest.mark.parametrize("groups", [2, pytest.param(8, marks=pytest.mark.full)])
def test_no_disturbed_joint_exceeds_the_worst_case_recursion(groups):
    count = Counted()
    along_time.judged(1, groups, 400, count)
    assert (count.exceeded, count.missed) == (0, 0), count.notes
    assert count.nearest > 0.99 and count.refused > 50


def test_no_parameter_outside_its_range_is_accepted():
    count = Counted()
    starts.judged_parameters(1, 20, count)
    assert count.missed == 0 and count.refused == 100, count.notes


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
def test_no_certified_quantity_of_an_arm_is_exceeded(joints):
    for judge, numbers in (
        (continuous.judged_settling, (4, 100)),
        (continuous.judged_ultimate, (4, 100)),
        (starts.judged, (4, 500)),
        (ratios.judged, (2, 100)),
    ):
        count = Counted()
        judge(1, *numbers, joints, count)
        assert (count.exceeded, count.missed) == (0, 0), count.notes


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
def test_monitor_warns_before_any_run_leaves_if_the_state_is_measured(joints):
    count = Counted()
    warned.judged(1, 2, 100, joints, count)
    assert count.missed == 0 and count.refused > 0


@pytest.mark.parametrize(("delay", "kalman"), [(0, False), (1, True)])
def test_no_error_exceeds_its_bound_for_random_laws(delay, kalman):
    shares, near = judged(1, delay, kalman, laws=2, runs=100)
    assert shares.max() <= 1.0 + 1e-6 and np.median(near) > 1.0 / 3.0


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
@pytest.mark.parametrize(("delay", "kalman"), KINDS)
def test_no_error_exceeds_its_bound_for_many_random_laws(delay, kalman, joints):
    count = Counted()
    shares, near = judged(2, delay, kalman, laws=5, runs=500, joints=joints, count=count)
    assert shares.max() <= 1.0 + 1e-6 and count.missed == 0 and np.median(near) > 1.0 / 3.0
