"""The model at mid-period, viscous feed-forward, and computed torque by its horizon."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify.arm.inertia_ratio import linear_loops
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import ComputedTorque, Kalman, KnownJoints, sampled_data
from slidax.motions import Sinusoid
from slidax.plant import Actuator, Constant, Delayed, Exact, Lossy, TorqueLimits
from slidax.scenarios import alter, load
from slidax.simulation import Plant, simulate
from tests.paper_examples import TWO_LINK_NOMINAL
from tests.simulation.simple import FreeMass

PERIOD = 2e-3


@pytest.mark.parametrize(
    ("delay", "dead_time", "adapts"), [(0.0, 0.0, False), (1.0, 0.0, True), (1.5, 0.5, False), (2.0, 1.0, False)]
)
def test_midpoint_law_equals_the_usual_law_for_constant_inertia(delay, dead_time, adapts):
    """The planned accelerations, limits included, equal those that the torques produce."""
    limits = TorqueLimits(3.0, 1000.0)
    sensor = Lossy(Delayed(Exact(), delay - dead_time), starts=[150, 300], counts=[6, 2])
    plant = Plant(FreeMass(), Constant([0.4]), sensor, Actuator(limits, dead_time=dead_time))
    motion, start = Sinusoid([0.0], 0.08, 5.0), State(q=[0.05], dq=[0.0])
    adaptation = KnownJoints(rotor=0.1, coulomb=0.2) if adapts else None

    def run(midpoint):
        law = sampled_data(
            ComputedTorque(FreeMass(), horizon=0.04),
            period=PERIOD,
            estimator=Kalman.steady(density=0.01, variance=1e-11, period=PERIOD),
            limits=limits,
            delay=delay,
            dead_time=dead_time,
            adaptation=adaptation,
            midpoint=midpoint,
        )
        return simulate(plant, law, motion, start, t1=1.0, period=PERIOD, substeps=2).log

    at_start, at_middle = run(False), run(True)
    limited = np.abs(at_start.tau) == 3.0
    assert np.any(limited[:100]) and not np.any(limited[140:])
    np.testing.assert_allclose(at_middle.tau, at_start.tau, atol=1e-9)


def test_the_midpoint_model_leaves_a_smaller_disturbance_estimate():
    """The arm equals its model, so that only sampling contributes to the disturbance."""
    changes = {
        "robot.plant": {},
        "robot.nominal.viscous": 0.2,
        "sensor.resolution": 0.0,
        "actuator": {},
        "simulation.t1": 1.0,
        "simulation.integrator": "rk4",
        "scheme": {
            "name": "computed_torque",
            "horizon": 0.02,
            "sampled_data": {
                "estimator": {"kind": "kalman", "acceleration_density": 3.0, "variance": 1e-12},
                "adaptation": None,
                "viscous_feedforward": True,
            },
        },
    }
    scenario = load("panda-payload", changes)
    scenarios = scenario, alter(scenario, {"scheme.sampled_data.midpoint": True})
    start, middle = (np.abs(s.simulate(log_every=1).log.signals["disturbance"][500:]).max(0) for s in scenarios)
    # Its own viscous friction is part of the prediction, and so is not estimated.
    assert np.all(start < 0.02)
    assert np.all(middle < 0.01 * start)


def test_viscous_friction_is_compensated_at_the_mean_velocity_of_the_reference():
    viscous = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    scenario = load("panda-payload", {"robot.nominal.viscous": viscous, "actuator": {}})
    other = alter(scenario, {"scheme.sampled_data.viscous_feedforward": True})
    h, t = scenario.period, jnp.asarray(0.0)
    now, after = (scenario.trajectory.reference(t + delta) for delta in (0.0, h))
    torques = []
    for law in (scenario.controller, other.controller):
        memory = law.init(t, scenario.state0, now)
        torques.append(law(t, scenario.state0, now, after, memory).tau)
    expected = np.array(viscous) * 0.5 * (now.dq + after.dq)
    assert np.max(np.abs(expected)) > 0.1
    np.testing.assert_allclose(torques[1] - torques[0], expected, atol=1e-12)


def test_viscous_feedforward_of_an_arm_without_viscous_friction_is_refused():
    with pytest.raises(DefinitionError, match=r"`TwoLink` has no `viscous`: leave it out"):
        sampled_data(ComputedTorque(TWO_LINK_NOMINAL), period=PERIOD, viscous_feedforward=True)
    with pytest.raises(DefinitionError, match=r"sampled_data.viscous_feedforward: .* set `robot.nominal.viscous`"):
        load("panda-payload", {"scheme.sampled_data.viscous_feedforward": True})


def test_a_horizon_places_a_double_eigenvalue():
    horizon = 0.02
    law = sampled_data(ComputedTorque(FreeMass(), horizon=horizon), period=PERIOD).step.law
    h, (kp, kd) = PERIOD, law.gains()
    period = np.array([[1.0, h], [0.0, 1.0]]) - np.outer([0.5 * h * h, h], [float(kp), float(kd)])
    np.testing.assert_allclose(np.trace(period), 2 * (1 - h / horizon), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.det(period), (1 - h / horizon) ** 2, rtol=1e-12)
    kp, kd = ComputedTorque(FreeMass(), horizon=horizon).gains()
    np.testing.assert_allclose(kd, 2 * np.sqrt(kp))
    with pytest.raises(DefinitionError, match=r"`ComputedTorque.horizon` must be at least the period of 0.002 s"):
        sampled_data(ComputedTorque(FreeMass(), horizon=1e-3), period=PERIOD)


def test_gains_and_a_horizon_together_are_refused():
    scheme = {"name": "computed_torque", "sampled_data": {}}
    assert load("panda-payload", {"scheme": {**scheme, "horizon": 0.02}}).controller.step.law.kp == 2500.0
    with pytest.raises(DefinitionError, match="`horizon` replaces `kp` and `kd`"):
        load("panda-payload", {"scheme": {**scheme, "horizon": 0.02, "kp": 100.0}})


def test_an_acceleration_density_gives_all_joints_equal_gains():
    estimator = {"kind": "kalman", "acceleration_density": 3.0}
    kalman = load("panda-payload", {"scheme.sampled_data.estimator": estimator}).controller.estimator
    expected = Kalman.steady(density=3.0, variance=1e-10 / 12, period=1e-3)
    np.testing.assert_allclose(kalman.gains, expected.gains, rtol=1e-12)
    with pytest.raises(DefinitionError, match="estimator: `acceleration_density` and `torque_density` both set"):
        load("panda-payload", {"scheme.sampled_data.estimator": {**estimator, "torque_density": 0.02}})


@pytest.mark.parametrize("option", ["midpoint", "viscous_feedforward"])
def test_linear_loop_analysis_excludes_midpoint_and_viscous_feedforward_laws(option):
    changes = {"robot.nominal.viscous": 0.2, "scheme.sampled_data.adaptation": None}
    scenario = load("panda-payload", changes)
    assert not isinstance(linear_loops(scenario), str)
    assert "mid-period" in linear_loops(alter(scenario, {f"scheme.sampled_data.{option}": True}))
