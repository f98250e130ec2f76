"""What the steps of laws without a bound decide, what is made up for, and what stands still at the limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.law import AbstractController, AbstractEstimator, Estimate, StepInput, sampled_data
from slidax.law.implicit_steps import Barrier, Plan
from slidax.plant import TorqueLimits
from tests.paper_examples import MOTION_4_1, MOTION_4_2, SCARA, START_4_2, TWO_LINK_NOMINAL
from tests.rivals import anftsmc_4_2, computed_torque_4_1, super_twisting_4_2

H, PERIOD = 0.012, 1e-3


def test_the_super_twisting_step_solves_its_inclusion_and_is_exactly_zero_where_that_says_so():
    """`s⁺ = s + H (v⁺ - k1 sig^½(s⁺))`, `v⁺ ∈ v - H k2 Sgn(s⁺)`."""
    law = super_twisting_4_2()
    step = sampled_data(law, period=PERIOD).step
    rng = np.random.default_rng(0)
    s = jnp.asarray(rng.normal(size=(500, 3)) * 10 ** rng.uniform(-4, 1, (500, 1)))
    v = jnp.asarray(rng.normal(size=(500, 3)) * 10 ** rng.uniform(-2, 1, (500, 1)))

    def reached(s, v):
        zero, one = jnp.zeros(3), jnp.ones(())
        state, reference = State(zero, zero), Reference(zero, zero, zero)
        times = {"t": one, "period": jnp.asarray(PERIOD), "horizon": jnp.asarray(H), "planned": jnp.ones((), bool)}
        arm = {"mass": jnp.eye(3), "bias": zero, "limits": TorqueLimits(), "expected": zero, "robot": SCARA}
        moment = StepInput(state=state, reference=reference, **times, **arm)
        frame = law.transformation.frame(one, one, one, ())
        plan = Plan.near(Barrier(frame, law.surface, times["horizon"]), zero, zero, s, zero)
        found = step.reach(moment, plan, v)
        return found.s_next, found.memory

    after, memory = jax.vmap(reached)(s, v)
    v_end = v + (memory - v) * H / PERIOD
    root = np.sign(after) * np.sqrt(np.abs(after))
    np.testing.assert_allclose(after, s + H * (v_end - law.k1 * root), atol=1e-13, rtol=1e-12)
    turned = np.asarray(v - v_end) / (H * 70.0)
    moving = np.asarray(after) != 0
    np.testing.assert_allclose(turned[moving], np.sign(after)[moving], rtol=1e-9)
    assert np.all(np.abs(turned[~moving]) <= 1.0)
    assert 200 < moving.sum() < 1300


class Believed(AbstractEstimator):
    """Says the measured state, and always the same disturbance."""

    disturbance: jax.Array

    def init(self, measured):
        return ()

    def __call__(self, measured, prior, elapsed, missed, memory):
        return Estimate(state=measured, disturbance=self.disturbance), ()


def first_torque(disturbance, limit):
    law = sampled_data(
        computed_torque_4_1(), period=PERIOD, limits=TorqueLimits(limit), estimator=Believed(jnp.asarray(disturbance))
    )
    t = jnp.zeros(())
    now, ahead = MOTION_4_1.reference(t), MOTION_4_1.reference(t + PERIOD)
    state = State(q=now.q, dq=now.dq)
    return law(t, state, now, ahead, law.init(t, state, now)), TWO_LINK_NOMINAL.mass(now.q) @ jnp.asarray(disturbance)


def test_a_law_without_a_bound_makes_up_for_a_push_as_far_as_the_drives_can():
    still, _ = first_torque([0.0, 0.0], 1e9)
    pushed, lumped = first_torque([0.5, -0.3], 1e9)
    np.testing.assert_allclose(still.tau - pushed.tau, lumped, rtol=1e-9)
    np.testing.assert_allclose(pushed.signals["disturbance"], [0.5, -0.3])
    astray, lumped = first_torque([500.0, -300.0], 60.0)
    share = 60.0 / float(jnp.abs(lumped).max())
    np.testing.assert_allclose(astray.signals["disturbance"], share * jnp.array([500.0, -300.0]), rtol=1e-12)
    np.testing.assert_array_equal(astray.memory.prior.disturbance, astray.signals["disturbance"])


@pytest.mark.parametrize("law", [super_twisting_4_2(), anftsmc_4_2(layer=0.01)], ids=["super_twisting", "anftsmc"])
def test_what_integrates_stands_still_while_the_limits_withhold_torque(law: AbstractController):
    t = jnp.zeros(())
    now, ahead = MOTION_4_2.reference(t), MOTION_4_2.reference(t + PERIOD)
    start = State(q=START_4_2.q + 0.3, dq=START_4_2.dq)

    def kept(limits):
        sampled = sampled_data(law, period=PERIOD, limits=limits)
        before = sampled.init(t, start, now)
        command = sampled(t, start, now, ahead, before)
        own = (lambda memory: memory.reaching) if hasattr(before.step, "reaching") else (lambda memory: memory)
        return np.asarray(own(before.step)), np.asarray(own(command.memory.step)), bool(command.memory.planned)

    before, free, planned = kept(TorqueLimits())
    assert planned and np.any(free != before)
    before, limited, planned = kept(TorqueLimits(20.0, 1000.0))
    assert not planned
    np.testing.assert_array_equal(limited, before)
