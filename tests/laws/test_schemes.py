"""Guarantees of every scheme on every arm, as printed and at the sampling rate of the arm."""

from typing import Any

import equinox as eqx
import numpy as np
import pytest

from slidax.law import SampledData
from slidax.plant import TorqueLimits
from slidax.scenarios import catalogue, load
from slidax.simulation import Run

ARMS = {"two_link": "example-4.1", "scara": "example-4.2", "panda": "panda-payload"}

SMOOTH = {"layer": 0.01}
"""A discontinuous torque chatters at any rate; these laws list no boundary layer."""

GAINS: dict[tuple[str, str], dict[str, Any]] = {
    **{(arm, scheme): SMOOTH for arm in ARMS for scheme in ("nftsmc", "anftsmc")},
    # These gains are in N m, and so depend on the size of the joint.
    ("panda", "gravity_pd"): {
        "kp": [800.0, 1500.0, 600.0, 600.0, 120.0, 80.0, 60.0],
        "kd": [80.0, 150.0, 60.0, 60.0, 12.0, 8.0, 6.0],
    },
    ("panda", "pid"): {
        "kp": [229.0, 680.0, 453.0, 362.0, 50.0, 53.0, 42.0],
        "ki": [2290.0, 6800.0, 4530.0, 3620.0, 500.0, 530.0, 420.0],
        "kd": [22.9, 68.0, 45.3, 36.2, 5.0, 5.3, 4.2],
    },
}

LAG = {"gravity_pd": 0.01, "pid": 0.01}
"""Admissible steady errors of schemes without a feedforward of the motion [rad or m]."""

UNDISTURBED = {("scara", "anftsmc"), ("scara", "computed_torque")}
"""Printed schemes whose gains are small against the disturbances of the example."""

COMPENSATED = {"two_link": 2e-5, "scara": 1e-4, "panda": 1e-3}
"""Admissible steady errors of schemes that compensate an estimated disturbance [rad or m]."""

SCHEMES = [name for name in catalogue()["schemes"] if name != "sliding_mode"]
"""All schemes but `sliding_mode`, which has no default parts."""

START, LOST = 2.0, 10
"""Time of the first lost sample [s], and number of lost samples."""


def pairs(turn: int) -> list:
    """Every scheme with every arm; the daily run has every second scheme, alternately on either small arm."""
    cases = []
    for arm in ARMS:
        for k, scheme in enumerate(SCHEMES):
            daily = k % 2 == turn and arm == ("two_link", "scara")[k // 2 % 2]
            marks = [] if daily else [pytest.mark.full]
            cases.append(pytest.param(arm, scheme, id=f"{scheme}, {arm}", marks=marks))
    return cases


def gains(arm: str, scheme: str) -> dict[str, Any]:
    return {"scheme.name": scheme} | {f"scheme.{name}": value for name, value in GAINS.get((arm, scheme), {}).items()}


def assert_settled(run: Run, error: float) -> None:
    """All values are finite, the error is inside the envelope, if any, and small over the last tenth."""
    assert run.outcome.kind == "ok", run.outcome.message
    log = run.log
    for leaf in (log.tau, log.state.q, log.state.dq, *log.signals.values()):
        assert np.all(np.isfinite(leaf))
    if log.envelope is not None:
        assert np.all((log.envelope.lower < log.e) & (log.e < log.envelope.upper))
    last = np.abs(log.e[-len(log.t) // 10 :]).max(0)
    assert np.all(last < error), last


@pytest.mark.parametrize(("arm", "scheme"), pairs(0))
def test_sampled_data_schemes_settle_within_limits_despite_lost_samples(arm, scheme):
    """With exact sensors, an arm that is not the nominal one, a disturbance or a payload, and one period of delay."""
    name = ARMS[arm] if arm == "panda" else f"{ARMS[arm]}-1khz"
    outage = {"outages": [{"start": START, "samples": LOST}]}
    changes: dict[str, Any] = {"sensor": {"loss": outage, "delay": 1}, "simulation.t1": 4.0}
    if arm == "panda":
        changes |= {"scheme.sampled_data": {}}
    scenario = load(name, {**changes, **gains(arm, scheme)})
    assert isinstance(scenario.controller, SampledData)
    # These drives have no limits, so the law alone must keep them.
    plant = eqx.tree_at(lambda plant: plant.actuator.limits, scenario.plant, TorqueLimits())
    run = scenario.replace(plant=plant).simulate(progress=False)
    assert_settled(run, LAG.get(scheme, COMPENSATED[arm]))
    tau, limits = np.asarray(run.log.tau), scenario.controller.limits
    assert np.all(np.abs(tau) <= np.asarray(limits.torque))
    steps = np.abs(np.diff(tau, axis=0))
    assert np.all(steps <= np.asarray(limits.rate) * scenario.period * (1 + 1e-12))
    lost = round(START / scenario.period)
    assert np.all(steps[lost : lost + LOST - 1] == 0.0) and np.all(steps[[lost - 2, lost + LOST]].max(1) > 0.0)


@pytest.mark.parametrize(("arm", "scheme"), pairs(1))
def test_printed_schemes_settle_on_their_arm_at_a_short_period(arm, scheme):
    changes: dict[str, Any] = {"simulation.t1": 4.0, "simulation.period": 2e-4}
    if (arm, scheme) in UNDISTURBED:
        changes["disturbance.scale"] = 0.0
    if arm == "panda":
        changes |= {
            "scheme.sampled_data": None,
            "simulation.period": 1e-4,
            "simulation.substeps": 1,
            "simulation.t1": 3.0,
            **{"robot.plant": {}, "actuator": {}, "sensor": {}},
        }
    run = load(ARMS[arm], {**changes, **gains(arm, scheme)}).simulate(progress=False)
    assert_settled(run, 0.01)
