"""Python and C agree, for every sampled-data law on every arm."""

from __future__ import annotations

import pytest

from slidax.scenarios import catalogue

from .agreement import NO_LIMITS, agree, in_full, named
from .exported import needs_a_compiler

pytestmark = needs_a_compiler

ARMS = ("example-4.1-1khz", "example-4.2-1khz")

# Torque limits hide most of the law at random states; one scheme shows that they are met alike.
PAIRS = [(arm, scheme, NO_LIMITS) for arm in ARMS for scheme in catalogue()["schemes"]] + [
    (arm, "cftsmppc", {}) for arm in ARMS
]


@pytest.mark.parametrize("pair", in_full(PAIRS, "cftsmppc", "slotine_li"), ids=named)
def test_the_torque_of_c_is_that_of_python(pair, tmp_path):
    agree(pair, tmp_path)
