"""What cannot be a sampled-data law is refused by name."""

from __future__ import annotations

import jax.numpy as jnp
import pytest

from slidax.core.errors import DefinitionError
from slidax.core.types import Command
from slidax.law import AbstractController, ComputedTorque, Measured, SampledData, sampled_data
from slidax.plant import TorqueLimits
from tests.paper_examples import SCARA, law_4_1


def test_a_law_that_does_not_plan_has_no_horizon():
    with pytest.raises(DefinitionError, match="`ComputedTorque` does not plan over a horizon; leave `horizon` out"):
        sampled_data(ComputedTorque(SCARA, 100.0, 20.0), period=1e-3, horizon=0.01)
    step = sampled_data(law_4_1(), period=1e-3).step
    with pytest.raises(DefinitionError, match=r"`SampledData.horizon` must be given for a law that plans"):
        SampledData(step, Measured(), TorqueLimits(), 1e-3)


def test_a_law_without_a_nominal_robot_has_no_sampled_data_form():
    class Blind(AbstractController):
        @property
        def joints(self):
            return 2

        def init(self, t, state, reference):
            return ()

        def __call__(self, t, state, reference_now, reference_next, memory):
            return Command(tau=jnp.zeros(2), memory=memory, signals={})

        def envelope(self, t, memory):
            return None

    with pytest.raises(DefinitionError, match="`Blind` has no `nominal` robot"):
        sampled_data(Blind(), period=1e-3)


def test_the_horizon_is_no_shorter_than_the_period():
    with pytest.raises(DefinitionError, match=r"`SampledData.horizon` must be >= `period` = 0.001"):
        sampled_data(law_4_1(), period=1e-3, horizon=5e-4)


def test_an_estimator_for_other_joints_is_refused():
    with pytest.raises(DefinitionError, match="`Measured` does not fit the 2 joints of TwoLink"):
        sampled_data(law_4_1(), period=1e-3, estimator=Measured([0.1, 0.2, 0.3]))
