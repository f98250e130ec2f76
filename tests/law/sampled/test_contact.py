"""A law in contact with a stop: its horizon sets the stiffness, and the monitor warns of a growing estimate."""

import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx

STIFF, DEPTH = 1e6, 5e-4


def against_a_stop(horizon, **of_scheme):
    """The law at the goal of its motion; a stop holds joint 1 half a millirad before the goal."""
    stop = {"kind": "elastic_stop", "stiffness": [STIFF, 0.0], "position": [1.25 - DEPTH, 9.0], "damping": [300.0, 0.0]}
    changes = {
        "disturbance.terms": [stop],
        "robot.plant": {"masses": [0.6, 1.8], "inertias": [6.0, 6.0], "lengths": [1.0, 0.8]},
        "scheme.sampled_data": {"horizon": horizon, "adaptation": None, **of_scheme},
        "simulation.t1": 10.0,
        "sensor.delay": 0,
    }
    scenario = sx.scenarios.load("example-4.1-1khz", changes)
    log = scenario.simulate(log_every=1, progress=False).log
    t, q = np.asarray(log.t), np.asarray(log.state.q)[:, 0]
    e = q - (1.25 - 1.4 * np.exp(-t) + 0.35 * np.exp(-4.0 * t))
    force = STIFF * np.maximum(0.0, q - 1.25 + DEPTH)
    inertia = np.asarray(scenario.controller.nominal.mass(jnp.array([1.25, 1.25])))[0]
    return t, e, force, inertia, log


HORIZONS = [0.024, *(pytest.param(horizon, marks=pytest.mark.full) for horizon in (0.012, 0.048))]


@pytest.mark.parametrize("horizon", HORIZONS)
def test_contact_stiffness_without_a_disturbance_estimate_is_inertia_over_the_squared_horizon(horizon):
    without = {"kind": "measured", "gain": 0.0, "trend": 0.0}
    t, e, force, inertia, _ = against_a_stop(horizon, estimator=without)
    rests = t > 9.0
    np.testing.assert_allclose(np.mean(force[rests] / -e[rests]), inertia[0] / horizon**2, rtol=0.06)


def test_disturbance_estimate_raises_the_contact_force_and_the_monitor_warns_at_its_bound():
    bound = 2.0
    t, e, force, inertia, log = against_a_stop(0.024, monitor={"disturbance": bound})
    touches = np.argmax(force > 0.0)
    alarm = np.asarray(log.signals["assumption_violated"]) >= 8.0
    first = np.argmax(alarm)
    assert first > touches and force[first] == pytest.approx(inertia[0] * bound, rel=0.15)
    pushed = -np.asarray(log.signals["disturbance"]) @ inertia
    rests = t > 9.0
    assert alarm[rests].all() and pushed[rests].min() > 2.0 * inertia[0] / 0.024**2 * DEPTH
    np.testing.assert_allclose(np.mean((force[rests] - pushed[rests]) / -e[rests]), inertia[0] / 0.024**2, rtol=0.1)
