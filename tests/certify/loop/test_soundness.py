"""No certified bound is exceeded: the law itself on random arms, with the worst known disturbances."""

from __future__ import annotations

import numpy as np
import pytest

from tests.soundness.counted import Counted
from tests.soundness.loops import KINDS, judged


@pytest.mark.parametrize(("delay", "kalman"), [(0, False), (1, True)])
def test_no_error_exceeds_its_bound_for_random_laws(delay, kalman):
    shares, near = judged(1, delay, kalman, laws=2, runs=100)
    assert shares.max() <= 1.0 + 1e-6
    assert np.median(near) > 1.0 / 3.0


@pytest.mark.full
@pytest.mark.parametrize("joints", range(1, 8))
@pytest.mark.parametrize(("delay", "kalman"), KINDS)
def test_no_error_exceeds_its_bound_for_many_random_laws(delay, kalman, joints):
    count = Counted()
    shares, near = judged(2, delay, kalman, laws=5, runs=500, joints=joints, count=count)
    assert shares.max() <= 1.0 + 1e-6
    assert count.missed == 0
    assert np.median(near) > 1.0 / 3.0
