"""Bounds along motions without an end: sinusoids, exponentials, a fixed posture."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import tracking_bound
from slidax.certify.motion.drive_limits import planned_torques
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.path_cells import PathCells, pieces_of
from slidax.certify.motion.tracking_bound import certified_path
from slidax.core.errors import DefinitionError
from slidax.motions import ConstantPosture, ExponentialSum, Sinusoid
from slidax.motions.tabulated import Tabulated
from slidax.scenarios.family import Family

from .test_tracking_bound import arm_of, at_the_edge, attack, uncertainty

PANDA = Path(__file__).parents[3] / "examples" / "motions" / "panda.yaml"
PLACE = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
AMPLITUDE, FREQUENCY = [0.4, 0.3, 0.4, 0.35, 0.4, 0.4, 0.5], [2.0, 2.4, 2.1, 2.2, 2.3, 2.4, 2.2]
WAVE = Sinusoid(PLACE, np.array(AMPLITUDE), np.array(FREQUENCY), 0.3)
DECAY = ExponentialSum(PLACE, np.stack([np.linspace(-0.4, 0.4, 7), np.linspace(0.1, -0.1, 7)]), np.array([1.0, 4.0]))
REST = ConstantPosture(PLACE)
MOTIONS = pytest.mark.parametrize("motion", [WAVE, DECAY, REST], ids=["sinusoid", "exponentials", "posture"])
PROMPT = JointLoop.with_density(1e-3, 0.007, 3.0, 1e-5, 0)


@MOTIONS
def test_derivatives_of_a_motion_agree_with_automatic_differentiation(motion):
    times = np.array([0.0, 0.37, 2.1])
    each = motion.position
    for order in range(5):
        expected = np.stack([np.asarray(each(jnp.asarray(t))) for t in times])
        np.testing.assert_allclose(motion.derivative(times, order), expected, rtol=1e-9, atol=1e-9)
        each = jax.jacfwd(each)


@MOTIONS
def test_largest_derivative_bounds_all_later_times(motion):
    since = np.array([0.0, 0.7])
    for order in range(1, 6):
        bounds = motion.largest_derivative(since, order)
        for time, bound in zip(since, bounds, strict=True):
            largest = np.abs(motion.derivative(np.linspace(time, 9.0, 5000), order)).max(axis=0)
            assert (largest <= bound * (1 + 1e-12)).all() and (bound <= 5.0 * largest).all()


@MOTIONS
def test_motion_bounds_of_a_path_cell_hold_between_its_samples(motion):
    cells = PathCells.of(motion, 2e-3, until=2.0)
    assert cells.until == 2.0
    t = np.linspace(0.0, 2.0, 40_001)
    index = np.minimum((t / (2 * cells.half)).astype(int), len(cells.q) - 1)
    for order, bound in enumerate((cells.speed, cells.acceleration, cells.jerk), start=1):
        value = np.abs(motion.derivative(t, order))
        assert (value <= bound[index] * (1 + 1e-12)).all() and value.sum() >= 0.9 * bound[index].sum()
    for order in (0, 1):
        extremes, values = pieces_of(motion, 2.0).extremes(order), motion.derivative(t, order)
        assert (extremes.least <= values.min(axis=0)).all() and (extremes.largest >= values.max(axis=0)).all()
        assert (extremes.largest - values.max(axis=0) < 1e-5).all()


@pytest.mark.parametrize("motion", [WAVE, DECAY], ids=["sinusoid", "exponentials"])
def test_adversarial_runs_along_smooth_motions_stay_within_the_bounds(motion):
    arm, rng = arm_of("panda"), np.random.default_rng(0)
    certified = certified_path(arm, motion, PROMPT, uncertainty(0.03), until=0.6)
    assert certified.bounds.verified
    ratios = attack(arm, motion, certified, rng, 6, at_the_edge(0.03))
    assert 0.1 < np.max(ratios) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("motion", [WAVE, DECAY], ids=["sinusoid", "exponentials"])
def test_long_adversarial_runs_along_smooth_motions_stay_within_the_bounds(motion):
    arm, rng = arm_of("panda"), np.random.default_rng(1)
    for p in (0.02, 0.05):
        certified = certified_path(arm, motion, PROMPT, uncertainty(p), until=3.0)
        assert certified.bounds.verified
        assert np.all(attack(arm, motion, certified, rng, 30, at_the_edge(p)) <= 1.0)


SINUSOID = {"kind": "sinusoid", "offset": PLACE.tolist(), "amplitude": AMPLITUDE, "frequency": FREQUENCY}
MOVING = {
    "trajectory": SINUSOID,
    "start.dq": (np.array(AMPLITUDE) * FREQUENCY).tolist(),
    "simulation.t1": 0.2,
    "tolerance": None,
}


def test_simulated_arms_that_start_in_motion_stay_within_the_bound():
    scenario = sx.scenarios.load(PANDA, MOVING)
    verdict = tracking_bound(scenario)
    assert verdict.holds and "up to 0.2 s" in verdict.statement
    assert any(line.text == "the arm's velocity at the start is known" for line in verdict.assumptions)
    family = Family.of(scenario.description)
    drawn = family.uncertain.values(np.random.default_rng(0).random((2, family.uncertain.dimensions)))
    times, along = verdict.bound["times"], verdict.bound["error_over_time"]
    for k in range(2):
        log = family.scenario({path: values[k] for path, values in drawn.items()}, "arm").simulate().log
        cell = np.clip(np.searchsorted(times, np.asarray(log.t), side="right") - 1, 0, len(times) - 1)
        assert (np.abs(np.asarray(log.e)) <= along[cell]).all()
        assert (np.abs(np.diff(np.asarray(log.tau), axis=0)).max(axis=0) < verdict.bound["torque_step"]).all()


def test_a_start_with_another_velocity_is_refused_with_the_covered_velocity():
    still = sx.scenarios.load(PANDA, {**MOVING, "start.dq": [0.0] * 7})
    refused = tracking_bound(still)
    assert refused.holds is None and "set `start.dq` to [0.8, 0.72" in refused.statement


def test_a_velocity_sensor_with_noise_is_refused_with_a_remedy_that_works():
    noisy = {**MOVING, "sensor": {"resolution": 1e-6, "velocity": "measured", "velocity_noise": 1e-3, "delay": 1}}
    refused = tracking_bound(sx.scenarios.load(PANDA, noisy))
    assert refused.holds is None and "set `sensor.velocity: differenced`" in refused.statement
    mended = {**MOVING, "sensor": {"resolution": 1e-6, "velocity": "differenced", "delay": 1}}
    assert tracking_bound(sx.scenarios.load(PANDA, mended)).holds


def test_a_motion_without_an_end_needs_an_end_time_and_a_settled_law_starts_at_rest():
    arm = arm_of("panda")
    with pytest.raises(DefinitionError, match="give `until`"):
        certified_path(arm, WAVE, PROMPT, uncertainty(0.03))
    with pytest.raises(DefinitionError, match="starts at rest"):
        certified_path(arm, WAVE, PROMPT, uncertainty(0.03, settled=True), until=0.1)


def test_first_planned_torque_step_starts_from_the_holding_torque():
    # The acceleration jumps at the start.
    arm, ends = arm_of("panda"), np.stack([PLACE, PLACE + 0.02])
    motion = Tabulated(np.array([0.0, 0.2]), np.stack([np.full((1, 7), 0.5), np.zeros((1, 7)), ends[:1]]))
    cells = PathCells.of(motion, 1e-3)
    _, step = planned_torques(arm, cells)
    needed = np.asarray(arm.mass(jnp.asarray(PLACE))) @ np.ones(7)
    np.testing.assert_allclose(step[0], np.abs(needed), rtol=0.02)
