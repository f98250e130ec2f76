"""The worked example of docs/certificates/loop-rate.md, and scenarios that a certificate refuses."""

import importlib
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.analysis.run_record import joint_loops
from slidax.certify.arm.demand import Demand
from slidax.certify.loop import inertia_ratio, loop_rate
from slidax.certify.loop.envelope import SampledEnvelope
from slidax.certify.loop.joint_responses import JointResponses
from slidax.scenarios import load


def demand(scenario, *, until=5.5, ratio=1.2, amplitude=1.0, stray=0.05, coupling=0.05, members=4):
    n, h = scenario.controller.joints, scenario.period
    times = np.arange(round(until / h) + 1) * h
    rng = np.random.default_rng(0)
    disturbance = [
        amplitude * np.sin(rng.uniform(0.5, 4.0, n) * times[:, None] + rng.uniform(0.0, 6.0, n)) for _ in range(members)
    ]
    return Demand(
        times=times,
        disturbance=np.stack(disturbance),
        stray=np.full((times.size, n), stray),
        kappa=np.array([[1.0 / ratio] * n, [ratio] * n]),
        coupling=coupling * (1.0 - np.eye(n)),
        assumptions=(),
    )


@pytest.fixture(scope="module")
def scenario():
    return load("example-4.1-1khz")


@pytest.mark.full
def test_worked_example_has_the_numbers_of_the_page(scenario):
    verdict = loop_rate(scenario, demand(scenario))
    assert verdict.holds
    np.testing.assert_allclose(verdict.bound["share"], [0.750, 0.833], rtol=0.01)
    np.testing.assert_allclose(verdict.bound["error_bound"], [7.1e-6, 8.3e-6], rtol=0.02)
    np.testing.assert_allclose(verdict.bound["required_radius"], [3.6e-5, 4.2e-5], rtol=0.03)
    np.testing.assert_allclose(verdict.bound["w_bar"], [0.23, 0.23], rtol=0.03)


@pytest.mark.full
def test_large_disturbance_fails_with_a_remedy_that_holds(scenario):
    request = demand(scenario, until=5.2, ratio=1.04, stray=3.0, coupling=0.0, members=1)
    verdict = loop_rate(scenario, request)
    assert verdict.holds is False
    wider = next(remedy for remedy in verdict.remedies if "scheme.performance.final" in remedy.changes)
    again = load("example-4.1-1khz", dict(wider.changes))
    assert float(np.max(loop_rate(again, request, remedies=False).bound["share"])) < 1.0


def test_loop_rate_does_not_apply_to_uncovered_laws(scenario):
    request = demand(scenario, until=0.5)
    for changes in ({"sensor.jitter": 0.1}, {"actuator.time_constant": 0.01}, {"scheme.sampled_data.delay": 0.0}):
        verdict = loop_rate(load("example-4.1-1khz", changes), request)
        assert verdict.holds is None and verdict.statement.startswith("not applicable")
    assert loop_rate(load("example-4.1"), request).holds is None


def test_unstable_loop_fails_in_both_certificates(scenario):
    wide = replace(demand(scenario, until=0.5), kappa=np.array([[0.2, 0.2], [1.0, 1.0]]))
    assert inertia_ratio(scenario, wide).holds is False
    assert loop_rate(scenario, wide, remedies=False).holds is False
    near = demand(scenario, until=0.5)
    assert inertia_ratio(scenario, replace(near, matrices=np.eye(2)[None] + 0.05 * np.ones((1, 2, 2)))).holds
    # Each joint by itself is no answer for joints that move each other.
    assert inertia_ratio(scenario, near).holds is None


def test_tails_bound_the_responses_beyond_their_length(scenario):
    loops = joint_loops(load("panda-payload"))[:2]
    kappa = np.array([[0.8, 1.2], [0.9, 1.1]])
    responses = JointResponses.of(loops, kappa)
    half = responses.of_change.shape[-1] // 2
    # A change of p that lasts asks for less and less: what is left after L is below its tail.
    last = responses.of_change[2:, ..., -half:].sum(axis=-1)
    assert np.all(last < responses.of_change[2:, ..., :half].sum(axis=-1))
    assert np.all(responses.of_change[2:, ..., -1] <= responses.change_tail[2:])
    assert np.all(responses.disturbance_tail >= 0.0) and np.all(np.isfinite(responses.noise))


def test_premises_of_the_closed_form_are_distinguished(scenario):
    law = scenario.controller
    drawn = law.step.transformation
    sides = drawn.init(jnp.zeros(()), jnp.array([0.1, -0.1]))
    calm = SampledEnvelope.of(drawn, sides, period=1e-3, horizon=3e-3, times=np.arange(4000) * 1e-3)
    assert not np.any(calm.slim) and not np.any(calm.unruly)
    hasty = SampledEnvelope.of(drawn, sides, period=1e-3, horizon=1.0, times=np.arange(7000) * 1e-3)
    assert np.any(hasty.slim) and np.all(hasty.unruly)


def test_required_radius_is_no_wider_than_an_envelope_that_holds(scenario, monkeypatch):
    request = demand(scenario, until=5.2, ratio=1.04, stray=0.05, coupling=0.0, members=1)
    final = np.asarray(scenario.controller.step.transformation.performance.final)
    monkeypatch.setattr(importlib.import_module("slidax.certify.loop.loop_rate"), "_required_radius", lambda _: wide)
    wide = np.array([1e-6, 1.0])
    verdict = loop_rate(scenario, request, remedies=False)
    assert verdict.holds
    np.testing.assert_array_equal(verdict.bound["required_radius"], np.broadcast_to(final, 2))
    wide = np.array([1e-6, 1e-6])
    np.testing.assert_array_equal(loop_rate(scenario, request, remedies=False).bound["required_radius"], wide)
