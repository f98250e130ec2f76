"""The monitor agrees with the theory, is silent while the guarantee holds, and warns early where it fails."""

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import analysis
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.export.guarded_step import GuardedStep
from slidax.export.status import PROMISE_VOID
from slidax.law import ComputedTorque, Kalman, Measured, Monitor, ftsmc, sampled_data
from slidax.motions import ConstantPosture as Still
from slidax.plant import Constant
from slidax.scenarios import load
from slidax.simulation import Plant, simulate
from tests.law.sampled.test_sampled_data import BOUND, mass_law
from tests.simulation.simple import FreeMass

H, PERIOD, FINAL = 1e-2, 2.5e-3, 0.05
MONITOR = {"scheme.sampled_data.monitor": {"share": 0.3}, "simulation.t1": 1.5}


def watched(push, monitor, delay=0.0, gain=0.0):
    law = sampled_data(
        mass_law(final=FINAL), period=PERIOD, horizon=H, estimator=Measured(gain), monitor=monitor, delay=delay
    )
    start = State(q=jnp.array([0.1]), dq=jnp.array([0.0]))
    plant = Plant(FreeMass(), Constant([push]))
    return law, simulate(plant, law, Still([0.0]), start, t1=3.0, period=PERIOD, outside="recover", log_every=1)


@pytest.mark.parametrize("push", [0.0, 3.0, 60.0, -60.0])
def test_margin_under_a_constant_disturbance_is_reduced_by_h_squared_w(push):
    """`x = H² w` of the loop-rate rule, against a share of the side that it points to; y settles at `H² w + ρ ψ(ε)`.

    The side towards the initial error is five times as wide: 60 m/s² there leave the margin of 12 m/s² on the other.
    """
    share = 0.5
    _, run = watched(push, Monitor(share=share))
    of_room = H * H * abs(push) / (share * (1.0 if push > 0.0 else 0.2) * FINAL)
    y = float(run.log.e[-1, 0]) / (0.95 * FINAL * np.where(run.log.e[-1, 0] * 0.1 > 0, 1.0, -0.2))
    assert run.log.signals["margin"][-1] == pytest.approx(1.0 - max(of_room, y), abs=2e-3)
    assert (run.log.signals["assumption_violated"][-1] > 0) == (max(of_room, y) > 1.0)


def run_of(changes):
    return load("example-4.1-1khz", {"scheme.sampled_data.adaptation": None} | changes).simulate()


def test_monitor_is_silent_while_the_guarantee_holds_and_changes_no_torque():
    silent, heard = run_of({"simulation.t1": 1.5}), run_of(MONITOR)
    np.testing.assert_array_equal(silent.log.tau, heard.log.tau)
    assert analysis.warned_at(heard) is None
    assert analysis.guarantee_margin(heard) == pytest.approx(heard.log.signals["margin"].min(), abs=0.05)
    assert analysis.guarantee_margin(heard) > 0.05 and analysis.guarantee_margin(silent) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"robot.plant.masses": [4.0, 4.0], "robot.plant.inertias": [1.0, 1.0]},
        {"disturbance.scale": 40},
        {"actuator.torque": 22},
    ],
    ids=["an arm four times as heavy", "a disturbance 40 times as large", "drives that are too weak"],
)
def test_monitor_warns_before_the_envelope_is_left(wrong):
    """Torque that the limits withhold violates the assumptions even if the model is right."""
    run = run_of(MONITOR | wrong)
    assert not run.outcome.ok and 0.0 < analysis.warned_at(run) < run.outcome.t


def test_monitor_warns_of_a_disturbance_too_fast_for_the_filter():
    """The estimate contains little of the disturbance before the mass is outside; the positions reveal it."""
    slow = Kalman.steady(density=1e-6, variance=1e-6, period=PERIOD)
    law = sampled_data(
        mass_law(final=FINAL), period=PERIOD, horizon=H, estimator=slow, monitor=Monitor(share=1.0, led=1.0)
    )
    plant, start = Plant(FreeMass(), Constant([-60.0])), State(q=jnp.array([0.1]), dq=jnp.array([0.0]))
    options = {"t1": 1.0, "period": PERIOD, "outside": "recover", "log_every": 1}
    log = simulate(plant, law, Still([0.0]), start, **options).log
    left = int(np.argmax(np.asarray(log.e[:, 0] <= log.envelope.lower[:, 0])))
    warned = np.asarray(log.signals["assumption_violated"]) > 0
    assert left > 0 and warned[:left].any() and not warned[: max(left // 4, 1)].any()


def test_a_learnt_inertia_outside_the_guarantee_is_reported():
    changes = {"scheme.sampled_data.monitor": {"rotor_max": -1.0}, "simulation.t1": 0.01}
    run = load("example-4.1-1khz", changes).simulate(log_every=1)
    assert (run.log.signals["assumption_violated"] == 2.0).all()


@pytest.mark.parametrize(("push", "is_set"), [(0.0, False), (3000.0, True)])
def test_guarded_step_status_has_the_monitors_bit_where_the_guarantee_is_void(push, is_set):
    law, _ = watched(0.0, Monitor())
    plant, start = Plant(FreeMass(), Constant([push])), State(q=jnp.array([0.1]), dq=jnp.array([0.0]))
    step = GuardedStep.around(law, law.limits, PERIOD)
    run = simulate(plant, step, Still([0.0]), start, t1=10 * PERIOD, period=PERIOD, outside="recover", log_every=1)
    status = run.log.signals["status"].astype(int)
    assert bool(status[-1] & PROMISE_VOID.bit) is is_set


@pytest.mark.parametrize(("push", "alarm"), [(1.9, 0.0), (2.1, 8.0)])
def test_a_law_without_a_plan_is_monitored_by_its_disturbance_estimate(push, alarm):
    law = sampled_data(
        ComputedTorque(FreeMass(), 100.0, 20.0),
        period=1e-3,
        estimator=Kalman.steady(density=1.0, variance=1e-12, period=1e-3),
        monitor=Monitor(disturbance=2.0),
    )
    start = State(q=jnp.zeros(1), dq=jnp.zeros(1))
    log = simulate(Plant(FreeMass(), Constant([push])), law, Still([0.0]), start, t1=1.0, period=1e-3, log_every=1).log
    assert log.signals["margin"][-1] == pytest.approx(1.0 - push / 2.0, abs=1e-3)
    assert log.signals["assumption_violated"][-1] == alarm


def test_monitor_of_a_law_with_a_plan_also_checks_the_estimated_disturbance():
    _, run = watched(3.0, Monitor(disturbance=2.0), gain=0.3)
    assert run.log.signals["assumption_violated"][-1] == 8.0
    assert run.log.signals["margin"][-1] == pytest.approx(1.0 - 3.0 / 2.0, abs=2e-2)


def test_a_monitor_needs_a_plan_and_an_envelope():
    with pytest.raises(DefinitionError, match="this law has none"):
        sampled_data(ComputedTorque(FreeMass(), 100.0, 20.0), period=1e-3, monitor=Monitor())
    law = sampled_data(ftsmc(FreeMass(), bound=BOUND), period=1e-3, monitor=Monitor())
    state = State(q=jnp.zeros(1), dq=jnp.zeros(1))
    with pytest.raises(DefinitionError, match="watches an envelope"):
        simulate(Plant(FreeMass(), Constant([0.0])), law, Still([0.0]), state, t1=0.01, period=1e-3)


def test_a_least_inertia_above_the_largest_is_refused():
    with pytest.raises(DefinitionError, match=r"`Monitor\.rotor_min` must be <= `rotor_max`; got 2.0 and 1.0"):
        Monitor(rotor_min=2.0, rotor_max=1.0)
