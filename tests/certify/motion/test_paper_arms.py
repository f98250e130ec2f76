"""The paper's arms under `tracking_bound`, as chains of rigid links."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import tracking_bound
from slidax.scenarios.family import Family
from tests.paper_examples import SCARA, TWO_LINK


@pytest.mark.parametrize("arm", [TWO_LINK, SCARA], ids=["two links", "scara"])
def test_rigid_link_model_of_a_paper_arm_agrees_with_its_closed_form(arm):
    links = arm.rigid_links()
    assert (links.joint_units, links.joint_names) == (arm.joint_units, arm.joint_names)
    for q, dq in jnp.asarray(np.random.default_rng(0).uniform(-3.0, 3.0, (5, 2, arm.joints))):
        pairs = [(links.mass(q), arm.mass(q)), (links.bias(q, dq), arm.bias(q, dq)), (links.tip(q), arm.tip(q))]
        for value, expected in pairs:
            np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)


NEAR: dict[str, Any] = {
    "scheme": {
        "name": "computed_torque",
        "horizon": 0.03,
        "sampled_data": {
            "midpoint": True,
            "adaptation": None,
            "estimator": {"kind": "kalman", "acceleration_density": 1.0},
        },
    },
    "sensor": {"resolution": 1e-5, "velocity": "differenced", "delay": 1},
    "simulation.t1": 0.5,
    "start.q": [0.2, 2.0],
    "start.dq": [0.0, 0.0],
    "robot.nominal": {},
    "disturbance.terms": [{"kind": "harmonic", "amplitude": [2.0, 1.0], "frequency": [1.0, 2.0]}],
    "actuator.torque": 200.0,
    "uncertainty": {
        "robot.plant.masses": {"around": "5 %", "each": "joint"},
        "robot.plant.inertias": {"around": "5 %", "each": "joint"},
    },
}


def test_simulated_two_link_arms_of_the_set_stay_within_the_tracking_bound():
    # The motion starts from rest with an acceleration that needs a torque step above 4 N m.
    assert tracking_bound(sx.scenarios.load("example-4.1-1khz", NEAR)).statement.startswith(
        "Not certified: planned torque step"
    )
    scenario = sx.scenarios.load("example-4.1-1khz", {**NEAR, "actuator.rate": 4e4})
    verdict = tracking_bound(scenario)
    assert verdict.holds, verdict.statement
    family = Family.of(scenario.description)
    corners = family.uncertain.values(np.array([[0.0] * 4, [1.0 - 1e-12] * 4, [0.0, 1.0 - 1e-12] * 2]))
    worst = np.zeros(2)
    for k in range(3):
        log = family.scenario({path: values[k] for path, values in corners.items()}, "arm").simulate().log
        worst = np.maximum(worst, np.abs(np.asarray(log.e)).max(axis=0))
    assert (worst <= verdict.bound["error"]).all() and (worst > 0.1 * verdict.bound["error"]).all()


BETWEEN_SAMPLES: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "a ripple at the sample rate": ([{"kind": "harmonic", "amplitude": [1.0, 0.5], "frequency": 2000.0 * np.pi}], {}),
    "a pulse between two samples": ([{"kind": "step", "value": [1.0, 0.5], "start": 0.2004, "end": 0.2008}], {}),
    "ten uncertain amplitudes": (
        [{"kind": "harmonic", "amplitude": [0.0, 0.0], "frequency": 20.0}] * 10,
        {f"disturbance.terms.{k}.amplitude": {"between": [[-0.1, -0.05], [0.1, 0.05]]} for k in range(10)},
    ),
}
"""Disturbances of up to 1 N m and 0.5 N m that are zero at each sample or in the middle of their set."""


@pytest.mark.parametrize("name", BETWEEN_SAMPLES)
def test_disturbance_counts_in_the_tracking_bound_with_its_largest_torque(name):
    def error(terms: list[dict[str, Any]], sets: dict[str, Any]) -> Any:
        changes = {"actuator.rate": 4e4, "disturbance.terms": terms, "uncertainty": {**NEAR["uncertainty"], **sets}}
        verdict = tracking_bound(sx.scenarios.load("example-4.1-1khz", {**NEAR, **changes}))
        assert verdict.holds, verdict.statement
        return verdict.bound["error"]

    bound = error(*BETWEEN_SAMPLES[name])
    np.testing.assert_allclose(bound, error([{"kind": "constant", "value": [1.0, 0.5]}], {}), rtol=1e-9)
    assert (bound > 1.1 * error([], {})).all()


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"start.q": [0.2, 2.1]}, "starts up to 0.1 rad from its motion in `joint 2`"),
        ({"robot.nominal": {"lengths": [1.01, 0.8]}}, "`robot.nominal.lengths`"),
        ({"uncertainty": {"robot.plant.lengths": {"around": "1 %", "each": "entry"}}}, "`robot.plant.lengths`"),
        ({"uncertainty": {"robot.plant.gravity_acceleration": {"between": [9.7, 9.9]}}}, "gravity_acceleration"),
    ],
    ids=["a start far away", "other lengths", "uncertain lengths", "uncertain gravity"],
)
def test_scenario_outside_the_tracking_bounds_scope_is_refused_with_the_setting(changes, named):
    verdict = tracking_bound(sx.scenarios.load("example-4.1-1khz", {**NEAR, **changes}))
    assert verdict.holds is None and named in verdict.statement
