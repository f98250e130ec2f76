"""Timing of a control loop."""

from __future__ import annotations

import pytest

from slidax.core.types import Timing


@pytest.mark.parametrize(("delay", "dead_time", "whole"), [(1.0, 2.0, 3), (1.0, 0.25, 1), (0.0, 1.75, 2)])
def test_total_delay_adds_the_dead_time_and_rounds_to_whole_periods(delay, dead_time, whole):
    timing = Timing(1e-3, delay, dead_time)
    assert timing.total_delay == delay + dead_time
    assert timing.whole_periods == whole
