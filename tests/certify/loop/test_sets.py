"""The certificate on whole scenarios: after the initial set no error of a case exceeds its bound."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify.arm.members import Members
from slidax.certify.loop import loop_rate
from slidax.certify.loop.envelope import SlopeTable, plan_deviation
from slidax.certify.loop.initial_set import planned_run, simulate_cases
from slidax.certify.loop.joint_responses import initial_directions
from slidax.certify.loop.problem import LoopProblem
from slidax.certify.loop.set_bound import set_bound
from slidax.law.error_transformations import psi_and_slope
from slidax.scenarios import load
from slidax.studies.cases import Cases
from tests.export.exported import COMPILERS
from tests.soundness.test_attack import attacked

SETS = {
    "masses": {"robot.plant.masses": {"around": "10 %", "each": "joint"}},
    "starts": {"robot.plant.masses": {"around": "5 %", "each": "joint"}, "start.q": {"around": 0.05, "each": "joint"}},
    "pushes": {
        "disturbance.scale": {"between": [0.0, 2.0]},
        "robot.plant.inertias": {"around": "8 %", "each": "joint"},
    },
}
WITHOUT = {"scheme.sampled_data.adaptation": None}
CASES = [
    ("example-4.1-1khz", SETS["masses"], {}),
    ("example-4.1-1khz", SETS["starts"], {}),
    ("example-4.1-1khz", SETS["pushes"], WITHOUT),
    ("example-4.1-1khz", SETS["masses"], {"sensor.resolution": 1e-6}),
    ("example-4.1-1khz", SETS["masses"], {"sensor.delay": 2, "scheme.sampled_data.horizon": 0.014}),
    ("example-4.2-1khz", {"robot.plant.masses": {"around": "5 %", "each": "joint"}}, {}),
    ("example-4.2-1khz", {"disturbance.scale": {"between": [0.5, 1.5]}}, WITHOUT),
]


def subject_of(name, uncertainty, changes):
    subject = LoopProblem.of(load(name, {"uncertainty": uncertainty, **changes}))
    assert isinstance(subject, LoopProblem)
    return subject


def share_of_the_bound(subject, whole, cases, seed):
    """The largest share of its bound that the error of any case reached."""
    members = Members.of(subject.scenario)
    space = members.family.space
    cube = np.random.default_rng(seed).uniform(0.0, 1.0, (cases, space.dimensions))
    cube[::2] = np.where(cube[::2] < 0.5, 0.0, np.nextafter(1.0, 0.0))
    first = whole.entry.sample + int(subject.dead_time)
    middle = whole.ideal.error
    worst = 0.0
    for run in Cases(members.family).logged(space.values(cube)):
        beside = np.asarray(run.log.e)[first : first + len(whole.bounds.error)] - middle[: len(whole.bounds.error)]
        below, above = whole.bounds.bounds.error[:, 0], whole.bounds.bounds.error[:, 1]
        bound = np.where(beside > 0.0, above, below)[: len(beside)]
        worst = max(worst, float(np.max(np.abs(beside) / np.maximum(bound, 1e-11))))
    return worst


def test_paper_example_at_1_khz_holds_with_uncertain_masses(tmp_path):
    name, masses, _ = CASES[0]
    subject = subject_of(name, masses, {"simulation.t1": 3.0})
    whole = set_bound(subject)
    assert whole.holds
    # The law learns: nothing is proved for more than the arms that were simulated.
    assert not any(line.status == "proved" for line in [*whole.premises, *whole.demand.assumptions])
    assert whole.assembly.set_in[0] < 2.0 and share_of_the_bound(subject, whole, 8, 1) <= 1.0
    if COMPILERS:
        assert 0.5 < attacked(subject.scenario, whole, tmp_path, 12) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_no_case_of_a_set_exceeds_its_bound(case):
    subject = subject_of(*case)
    whole = set_bound(subject)
    assert not isinstance(whole, str)
    if whole.bounds is not None:
        assert share_of_the_bound(subject, whole, 96, 2) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("name", ["example-4.1-1khz", "example-4.2-1khz"])
def test_built_in_scenarios_hold_with_a_tenth_of_their_radius(name):
    verdict = loop_rate(load(name))
    assert verdict.holds and not verdict.remedies
    assert (np.asarray(verdict.bound["required_radius"]) < 2e-4).all()


def test_nominal_run_is_that_of_an_arm_equal_to_its_model():
    exact = {"robot.plant.masses": [0.6, 1.8], "robot.plant.inertias": [6.0, 6.0], "disturbance.scale": 0.0}
    subject = LoopProblem.of(load("example-4.1-1khz", {**exact, "simulation.t1": 1.5, **WITHOUT}))
    approach = simulate_cases(subject)
    entry = approach.entry(approach.late)
    ideal = planned_run(subject, entry)
    run = subject.scenario.simulate(log_every=1, progress=False)
    e = np.asarray(run.log.e)[entry.sample : entry.sample + len(ideal.error)]
    assert np.abs(e - ideal.error[: len(e)]).max() < 1e-3 * np.abs(e).max()


def test_loop_rate_fails_for_a_large_set_with_a_failing_assumption():
    wild = {"robot.plant.masses": {"between": [0.05, 8.0]}}
    verdict = loop_rate(load("example-4.1-1khz", {"uncertainty": wild, **WITHOUT}), remedies=False)
    assert verdict.holds is False and any(line.status == "fails" for line in verdict.assumptions)


def test_slope_table_bounds_all_slopes_between_two_places():
    subject = subject_of(*CASES[0])
    sides = subject.drawn.init(jnp.zeros(()), jnp.asarray(subject.start()[0]))
    slopes = SlopeTable.of(subject.surface, sides)
    slope_at = jax.vmap(lambda eps: subject.surface.phi_and_slope(eps)[1] / psi_and_slope(eps, sides)[1])
    rng = np.random.default_rng(0)
    for _ in range(20):
        ends = np.sort(rng.choice([-1.0, 1.0], (2, 2)) * 10 ** rng.uniform(-6.0, 1.0, (2, 2)), axis=0)
        least, most = slopes.between(jnp.asarray(ends[0]), jnp.asarray(ends[1]))
        slope = np.asarray(slope_at(ends[0] + np.linspace(0.0, 1.0, 201)[:, None] * (ends[1] - ends[0])))
        assert (np.asarray(least) <= slope * (1 + 1e-12)).all()
        assert (slope <= np.asarray(most) * (1 + 1e-12)).all()


def test_plan_deviation_bounds_solutions_for_other_targets():
    subject = subject_of(*CASES[0])
    sides = subject.drawn.init(jnp.zeros(()), jnp.asarray(subject.start()[0]))
    radius, horizon = jnp.array([0.3, 0.002]), jnp.asarray(0.012)
    middle = jnp.array([0.1, -1e-4])
    zero, origin = jnp.zeros((2, 2, 1)), (jnp.zeros(2), jnp.zeros(2))

    def solved(x):
        size = jnp.abs(x)[None, :, None] + zero
        place, _, eps = plan_deviation(subject.surface, sides, radius, horizon, origin, size, zero)
        sides_of = (np.asarray(x) > 0).astype(int), np.arange(2), 0
        return np.asarray(eps)[sides_of], np.asarray(place)[sides_of]

    eps, share = solved(middle)
    reach = jnp.array([[0.02, 3e-5], [0.01, 4e-5]])[:, :, None]
    below_and_above, _, _ = plan_deviation(
        subject.surface,
        sides,
        radius,
        horizon,
        (middle, jnp.asarray(eps)),
        reach,
        jnp.asarray(eps)[None, :, None] + zero,
    )
    for k, sign in enumerate((-1.0, 1.0)):
        there = middle + sign * reach[k, :, 0]
        moved = np.sign(there) * solved(there)[1] - np.sign(middle) * share
        np.testing.assert_allclose(np.abs(moved), below_and_above[k, :, 0], rtol=1e-6, atol=1e-12)


def test_planned_error_direction_needs_no_acceleration():
    subject = subject_of(*CASES[0])
    loop, follows = subject.loops[0], 0.4
    basis, sizes = initial_directions(loop, follows, np.zeros((1, 9)))
    maps = loop.maps(1.1)
    led = maps.outputs[2] @ basis[:, 0]
    held = np.zeros(5)
    held[2] = follows * led
    command = maps.outputs[4] @ basis[:, 0] + maps.direct[4] @ held
    # The delay moves e a little further before the plan begins.
    assert abs(command) < 0.1 * abs((1 - follows) * led / loop.horizon**2) and (sizes == 0.0).all()
