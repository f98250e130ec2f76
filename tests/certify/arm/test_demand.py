"""The lumped disturbance bound of a set, and torque certificates: failures have valid remedies."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.signal import lfilter

from slidax.certify.arm import compute_demand, robust_torque, torque_budget, uncertainty_bound
from slidax.certify.arm.members import Members
from slidax.certify.arm.robust_torque import UncertaintySamples, largest_share, uncertainty_samples
from slidax.certify.arm.torque_budget import motion_torques
from slidax.core.types import State
from slidax.law import SampledData
from slidax.scenarios import Scenario, load
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter
from slidax.scenarios.uncertainty import Uncertainty


def with_set(scenario: Scenario, uncertainty: dict[str, Any], changes: dict[str, Any]) -> tuple[Scenario, Family]:
    changed = alter(scenario, changes)
    return changed, Family.of(changed.description, TypeAdapter(Uncertainty).validate_python(uncertainty))


def member(family: Family, seed: int) -> Any:
    """The plant of one random member, as a scenario file defines it."""
    cube = np.random.default_rng(seed).uniform(size=(1, family.space.dimensions))
    values = {path: some[0] for path, some in family.space.values(cube).items()}
    plant = family.case(values).as_it_is().moving().plant
    return getattr(plant, "own", plant)


def lumped_disturbance_of(scenario: Scenario) -> Any:
    """Return a function from a member and times to w* on the reference [N n]."""
    law, h = scenario.controller, scenario.period
    robot, rubbed = law.nominal, jnp.zeros(law.joints)
    adaptation = law.adaptation if isinstance(law, SampledData) else None
    memory = None if adaptation is None else adaptation.init(scenario.state0)

    @eqx.filter_jit
    def answers(plant: Any, times: Any) -> Any:
        return jax.vmap(lambda t: at(plant, t))(times)

    def at(plant: Any, t: Any) -> Any:
        now, later = (scenario.trajectory.reference(args) for args in (t, t + h))
        ddq = (later.dq - now.dq) / h
        believed, friction = robot, rubbed
        if adaptation is not None:
            believed, friction = adaptation.robot(robot, memory), adaptation.friction(memory, now.dq)
        state = State(q=now.q, dq=now.dq)
        true = plant.at(t)
        known = believed.mass(state.q) @ ddq + believed.bias(state.q, state.dq) + friction
        needed = true.mass(state.q) @ ddq + true.bias(state.q, state.dq) + true.friction(state.dq)
        return jnp.linalg.solve(believed.mass(state.q), known - needed + plant.disturbance(t, state))

    return answers


SETS = {
    "two links": (
        "example-4.1-1khz",
        {
            "robot.plant.masses": {"around": "20 %", "each": "entry"},
            "robot.plant.lengths": {"around": "5 %", "each": "entry"},
            "robot.plant.gravity_acceleration": {"between": [9.7, 9.9]},
            "disturbance.scale": {"between": [0, 1]},
            "start": {"inside": "envelope"},
        },
        {"simulation.t1": 0.3},
    ),
    "scara": (
        "example-4.2-1khz",
        {"robot.plant.masses": {"around": "20 %"}, "disturbance.scale": {"between": [0.5, 1.5]}},
        {"simulation.t1": 0.3},
    ),
}

SLOW = {
    "panda": (
        "panda-payload",
        {
            "robot.plant.load.mass": {"between": [0, 3]},
            "robot.plant.load.center": {"ball": 0.05},
            "robot.plant.mass_factor": {"around": "20 %"},
            "robot.plant.coulomb": {"between": [0.1, 0.5], "each": "joint"},
            "robot.plant.armature": {"between": [0.05, 0.2], "distribution": "log_uniform"},
        },
        {"robot.plant.load.inertia": 0, "simulation.t1": 2.0},
    ),
    "ur5e": (
        "ur5e-payload",
        {"robot.plant.load.mass": {"between": [0, 3]}, "robot.plant.viscous": {"between": [0, 1], "each": "joint"}},
        {"robot.plant.load.inertia": 0, "simulation.t1": 2.0},
    ),
}

ALL = [pytest.param(name, id=name) for name in SETS] + [
    pytest.param(name, id=name, marks=pytest.mark.full) for name in SLOW
]


@pytest.mark.parametrize("name", ALL)
def test_lumped_disturbance_bound_holds_for_random_arms_of_the_set(name):
    base, uncertainty, changes = (SETS | SLOW)[name]
    scenario, family = with_set(load(base), uncertainty, changes)
    bounds = compute_demand(scenario, family)
    lumped_disturbance = lumped_disturbance_of(scenario)
    random = np.random.default_rng(5)
    # The hull bounds a signal through any filter; these filters are random.
    filters = random.normal(size=(10, 30))
    close = 0.0
    for seed in range(5 if name in SETS else 20):
        plant = member(family, seed)
        exact = np.asarray(lumped_disturbance(plant, bounds.times))
        for weights in filters:

            def through(w, weights=weights):
                return lfilter(weights, 1.0, w, axis=-2)

            limit = bounds.worst(through)
            answer = np.abs(through(exact))
            assert (answer <= limit * (1 + 1e-7) + 1e-9).all()
            close = max(close, float((answer / limit).max()))
    assert close > 0.5


SHORT = {"simulation.t1": 1.0}

# Some of these tests use implausible values on purpose.
MEANT = pytest.mark.filterwarnings("ignore::slidax.core.errors.DefinitionWarning")


@pytest.fixture(scope="module")
def two_links():
    return with_set(
        load("example-4.1-1khz"),
        {"robot.plant.masses": {"around": "20 %"}, "disturbance.scale": {"between": [0, 1]}},
        SHORT,
    )


@pytest.fixture(scope="module")
def demand_of_two_links(two_links):
    return compute_demand(*two_links)


@MEANT
def test_robust_torque_certificate_fails_for_a_small_bound_and_its_remedy_holds(two_links, demand_of_two_links):
    scenario, _ = two_links
    good = robust_torque(scenario, demand_of_two_links)
    assert good.holds and good.margin > 0.5
    nothing = {f"scheme.bound.{name}": 0.0 for name in ("b0", "b1", "b2")} | {"scheme.bound.margin": 0.01}
    weak = alter(scenario, nothing | {"scheme.bound.inverse_inertia_max": 0.09})
    refused = robust_torque(weak, demand_of_two_links)
    assert refused.holds is False and refused.bound["needed"] == pytest.approx(good.bound["needed"], rel=1e-6)
    enough = robust_torque(alter(weak, dict(refused.remedies[0].changes)), demand_of_two_links)
    assert enough.holds


def test_robust_torque_certificate_does_not_apply_to_computed_torque():
    scenario = load("example-4.1-1khz", {"scheme.name": "computed_torque", **SHORT})
    assert robust_torque(scenario).holds is None


def start_on_the_motion() -> dict[str, Any]:
    reference = load("example-4.1-1khz", SHORT).trajectory.reference(jnp.zeros(()))
    start = {"start.q": np.asarray(reference.q).tolist(), "start.dq": np.asarray(reference.dq).tolist()}
    return SHORT | start | {"disturbance.scale": 0.0, "actuator.rate": 1e6}


def test_predicted_peak_torque_of_an_exactly_known_arm_is_the_simulated_peak():
    scenario = load("example-4.1-1khz", start_on_the_motion() | {"robot.nominal": {}})
    tau = np.asarray(scenario.simulate(log_every=1, progress=False).log.tau)
    torque, _ = motion_torques(scenario, compute_demand(scenario), Members.of(scenario))
    np.testing.assert_allclose(torque, np.abs(tau).max(axis=0), rtol=1e-6)


@MEANT
def test_torque_budget_fails_for_weak_drives_with_a_sufficient_remedy(two_links, demand_of_two_links):
    scenario, family = two_links
    weak = alter(scenario, {"actuator.torque": 30.0})
    refused = torque_budget(weak, demand_of_two_links, family)
    assert refused.holds is False and (np.asarray(refused.bound["torque"]) > 30.0).any()
    stronger = alter(weak, dict(refused.remedies[0].changes))
    torque = torque_budget(stronger, demand_of_two_links, family).bound["torque"]
    assert (torque < np.asarray(stronger.plant.actuator.limits.torque)).all()


def test_torque_budget_holds_from_a_time_on_for_a_distant_start():
    near = torque_budget(load("example-4.1-1khz", start_on_the_motion()))
    reached = torque_budget(load("example-4.1-1khz", SHORT))
    assert near.holds and near.since is None, near.statement
    assert reached.holds and reached.since == max(reached.bound["free_after"]) > 0.0
    assert reached.answer == f"from {reached.since:.3g} s" and reached.margin > 0.1


def test_torque_budget_fails_if_a_limit_is_reached_up_to_the_end():
    # The drives can barely hold the motion and chatter at their rate limit until the end.
    scenario = load("example-4.1-1khz", SHORT | {"actuator.rate": 600.0})
    verdict = torque_budget(scenario)
    assert verdict.holds is False and verdict.since is None and verdict.margin is None
    assert "up to the end" in verdict.statement


def test_uncertainty_share_with_zero_bounds_is_infinite_unless_the_torque_term_covers():
    samples = UncertaintySamples(*(np.array([1.0, 2.0]) for _ in range(4)))
    assert largest_share(np.zeros(3), 0.0, samples) == np.inf
    assert largest_share(np.zeros(3), 1.0, samples) == 0.0
    assert largest_share(np.array([4.0, 0.0, 0.0]), 0.0, samples) == 0.5


@MEANT
def test_uncertainty_bound_does_not_apply_to_sampled_data_laws():
    verdict = uncertainty_bound(
        load("example-4.1-1khz", SHORT | {f"scheme.bound.{b}": 0.0 for b in ("b0", "b1", "b2")})
    )
    assert verdict.holds is None and verdict.answer == "-"
    assert all(abs(number) < 1e6 for number in verdict.bound.values())


def test_torque_budget_does_not_apply_without_limits():
    scenario = load("example-4.1", {"simulation.t1": 0.01})
    assert torque_budget(scenario).holds is None


def test_smallest_uncertainty_bound_covers_new_samples_and_a_smaller_bound_has_a_valid_remedy():
    scenario, family = with_set(load("example-4.1"), {"robot.plant.masses": {"around": "20 %"}}, {"simulation.t1": 2.0})
    verdict = uncertainty_bound(scenario, family)
    assert verdict.holds
    fresh = uncertainty_samples(Members.of(scenario, family), 16, seed=99)
    b0, b1, b2, gamma = (verdict.bound[name] for name in ("b0", "b1", "b2", "gamma"))
    covered = b0 + b1 * fresh.position + b2 * fresh.speed + gamma * fresh.torque
    assert np.mean(fresh.lumped > covered * (1 + 1e-9)) < 1e-3
    smaller = {f"scheme.bound.{name}": 0.3 * verdict.bound[name] for name in ("b0", "b1", "b2")}
    refused = uncertainty_bound(alter(scenario, smaller), family)
    assert refused.holds is False
    assert uncertainty_bound(alter(scenario, dict(refused.remedies[0].changes)), family).holds


def test_a_deadline_that_is_too_short_for_the_drives_gets_a_longer_one_as_remedy():
    path = "scheme.transformation.performance.deadline"
    verdict = torque_budget(load("example-4.1-1khz", {path: 0.6}))
    assert verdict.holds is False
    (remedy,) = verdict.remedies
    assert set(remedy.changes) == {path}
    assert torque_budget(load("example-4.1-1khz", dict(remedy.changes))).holds
