"""Uncertainty sets by path, drawn from the unit cube, and paths of single numbers. The law knows nothing of them."""

from typing import Any

import jax
import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.scenarios import load
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.scenarios.uncertainty import Uncertainty
from tests.cli.commands import in_process

NAME = "example-4.1-1khz"
CUBE = np.random.default_rng(3).random((4000, 2))


def family(sets: dict[str, Any], name: str = NAME, **changes: Any) -> Family:
    return Family.of(scenarios.load(name, {"uncertainty": sets, **changes}).description)


def drawn(path: str, entry: dict[str, Any], name: str = NAME) -> np.ndarray:
    sets_family = family({path: entry}, name)
    cube = np.random.default_rng(3).random((4000, sets_family.space.dimensions))
    return sets_family.space.values(cube)[path]


def fits(values: np.ndarray, distribution: Any) -> bool:
    """True if the values pass a Kolmogorov-Smirnov test; 4000 values of another distribution do not."""
    return bool(stats.kstest(values, distribution).pvalue > 1e-3)


def test_values_between_two_ends_are_uniform_unless_another_distribution_is_named():
    between = {"between": [0.5, 2.0]}
    assert fits(drawn("disturbance.scale", between), stats.uniform(0.5, 1.5).cdf)
    log = drawn("disturbance.scale", {**between, "distribution": "log_uniform"})
    assert fits(log, stats.loguniform(0.5, 2.0).cdf) and not fits(log, stats.uniform(0.5, 1.5).cdf)
    peak = drawn("disturbance.scale", {**between, "distribution": "triangular"})
    assert fits(peak, stats.triang(0.5, 0.5, 1.5).cdf)
    normal = drawn("disturbance.scale", {**between, "distribution": "normal", "mean": 1.0, "deviation": 0.5})
    assert fits(normal, stats.truncnorm(-1.0, 2.0, 1.0, 0.5).cdf)


def test_values_around_the_nominal_vary_by_percent_or_by_an_absolute_amount():
    share = drawn("robot.plant.masses", {"around": "20 %"})
    assert np.allclose(share.min(axis=0), [0.4, 1.2], rtol=1e-3) and np.allclose(
        share.max(axis=0), [0.6, 1.8], rtol=1e-3
    )
    # One draw for all joints: the masses stay in proportion.
    assert np.allclose(share[:, 1] / share[:, 0], 3.0)
    each = drawn("robot.plant.masses", {"around": "20 %", "each": "joint"})
    assert abs(np.corrcoef(each.T)[0, 1]) < 0.05
    assert np.ptp(drawn("start.q", {"around": 0.1})[:, 0]) == pytest.approx(0.2, rel=1e-2)


def test_each_joint_draws_its_own_value_on_request():
    path = "robot.plant.coulomb"
    assert drawn(path, {"between": [0.1, 0.5]}, "panda-payload").shape == (4000,)
    each = drawn(path, {"between": [0.1, 0.5], "each": "joint"}, "panda-payload")
    assert each.shape == (4000, 7) and np.abs(np.corrcoef(each.T) - np.eye(7)).max() < 0.08


def test_a_ball_is_filled_evenly_in_all_directions():
    center = drawn("robot.plant.load.center", {"ball": 0.05}, "panda-payload") - np.array([0.0, 0.0, 0.1])
    far = np.linalg.norm(center, axis=1) / 0.05
    assert far.max() < 1.0 and fits(far**3, "uniform") and np.abs(center.mean(axis=0)).max() < 0.002
    on = drawn("robot.plant.load.center", {"ball": 0.05, "distribution": "surface"}, "panda-payload")
    assert np.allclose(np.linalg.norm(on - np.array([0.0, 0.0, 0.1]), axis=1), 0.05)


def test_choices_follow_their_weights_and_the_choice_any_draws_distinct_seeds():
    delays = drawn("sensor.delay", {"choice": [1, 2, 5], "weights": [1, 2, 1]})
    values, counts = np.unique(delays, return_counts=True)
    assert values.tolist() == [1, 2, 5] and np.allclose(counts / 4000, [0.25, 0.5, 0.25], atol=0.03)
    seeds = drawn("sensor.seed", {"choice": "any"})
    assert seeds.dtype.kind == "i" and len(np.unique(seeds)) > 3990


def test_drawn_starts_fill_the_requested_share_of_the_envelope():
    sets_family = family({"start": {"inside": "envelope", "share": 0.5}})
    q = sets_family.space.values(CUBE)["start.q"]
    loaded = scenarios.load(NAME)
    t = jax.numpy.zeros(())
    e = q - np.asarray(loaded.trajectory.position(t))
    # The initial radii are 0.8 and 0.6 rad, the overshoot is 0.2: the interval is (-0.2 rho0, rho0) or its mirror.
    half, middle = np.ptp(e, axis=0) / 2, (e.max(axis=0) + e.min(axis=0)) / 2
    assert np.allclose(half, 0.5 * 0.5 * 1.2 * np.array([0.8, 0.6]), rtol=1e-2)
    assert np.allclose(np.abs(middle), 0.4 * np.array([0.8, 0.6]), rtol=2e-2)


def test_law_does_not_depend_on_the_drawn_values():
    sets = {
        "robot.plant.mass_factor": {"around": "20 %"},
        "robot.plant.load.mass": {"between": [0.5, 3]},
        "sensor.delay": {"choice": [3]},
        "robot.nominal.armature": {"choice": [0.02]},
    }
    sets_family = family(sets, "panda-payload")
    values = {
        path: array[0]
        for path, array in sets_family.space.values(np.full((1, sets_family.space.dimensions), 0.9)).items()
    }
    case, own = sets_family.scenario(values, "case"), scenarios.load("panda-payload")
    leaves = [jax.tree.leaves(scenario.controller) for scenario in (case, own)]
    assert all(np.array_equal(a, b) for a, b in zip(*leaves, strict=True))
    assert float(case.plant.load.payload.mass) == pytest.approx(2.75) and case.plant.sensor.periods == 3.0
    assert np.allclose(case.plant.robot.armature, 0.02)
    # With `--set`, the same values do change the law.
    told = scenarios.load("panda-payload", {"sensor.delay": 3, "robot.nominal.armature": 0.02})
    assert not all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(told.controller), leaves[1], strict=False))


def test_standard_errors_in_an_identified_arm_file_serve_as_an_uncertainty_set(tmp_path):
    arm = tmp_path / "arm.yaml"
    arm.write_text(
        'robot:\n  kind: "panda"\n  nominal: {armature: [0.1, 0.1, 0.1, 0.1, 0.05, 0.05, 0.05]}\n'
        "  plant: {coulomb: 0.4}\n"
        "uncertainty:\n"
        "  robot.nominal.armature: {standard_error: [.01, .01, .01, .01, .3, .01, 0.01], identifiable: true}\n"
        '  robot.plant.coulomb: {standard_error: 0.05, unit: "N m", identifiable: false}\n',
        encoding="utf-8",
    )
    changes = {"robot": {"kind": "identified", "file": str(arm)}, "uncertainty": {"file": str(arm)}}
    sets_family = Family.of(scenarios.load("panda-payload", changes).description)
    values = sets_family.space.values(np.random.default_rng(0).random((2000, sets_family.space.dimensions)))
    rotors = values["robot.nominal.armature"]
    assert rotors[:, 0].std() == pytest.approx(0.01, rel=0.05) and rotors[:, 0].max() <= 0.1301
    # A rotor has no inertia below zero, however wide the estimate.
    assert rotors[:, 4].min() == 0.0 and values["robot.plant.coulomb"].mean() == pytest.approx(0.4, abs=0.01)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"robot.plant.mases": {"around": "20 %"}}, "did you mean `masses`"),
    ({"robot.plan.masses": {"around": "20 %"}}, "did you mean `plant`"),
    ({"robot.kind": {"choice": [1]}}, "is not a number"),
    ({"robot.plant": {"choice": [1]}}, "is not a number"),
    ({"disturbance.terms.7.amplitude": {"around": 1}}, "does not exist in"),
    ({"robot.plant.masses": {"around": "20"}}, "20 %"),
    ({"robot.plant.masses": {"around": -1}}, ">= 0"),
    ({"robot.plant.masses": {"around": "150 %"}}, "must be > 0"),
    ({"robot.plant.masses": {"between": [1, 0]}}, "is empty"),
    ({"robot.plant.masses": {"between": [1]}}, ">= 2 entries"),
    ({"robot.plant.masses": {"between": [0.5, [1, 2, 3]]}}, "[2] numbers"),
    ({"disturbance.scale": {"between": [0, 1], "distribution": "log_uniform"}}, "ends > 0"),
    ({"disturbance.scale": {"between": [0, 1], "mean": 0.5}}, "only for `normal`"),
    ({"disturbance.scale": {"between": [0, 1], "distribution": "gauss"}}, "`uniform`"),
    ({"disturbance.scale": {"between": [0, 1], "around": 1}}, "needs one set"),
    ({"disturbance.scale": {"betwen": [0, 1]}}, "needs one set"),
    ({"disturbance.scale": 3}, "needs one set"),
    ({"disturbance.scale": {"between": [0, 1], "each": "axis"}}, "`joint`"),
    ({"disturbance.scale": {"choice": []}}, ">= 1 entry"),
    ({"disturbance.scale": {"choice": "any"}}, "for seeds"),
    ({"disturbance.scale": {"choice": [1, 2], "weights": [1]}}, "2 numbers"),
    ({"disturbance.scale": {"choice": [1, 2], "weights": [0, 0]}}, "not all 0"),
    ({"sensor.seed": {"choice": [0.5]}}, "whole number"),
    ({"disturbance.scale": {"inside": "envelope"}}, "only for the path `start`"),
    ({"start": {"inside": "envelope", "share": 1.5}}, "< 1"),
    ({"start": {"inside": "box"}}, "envelope"),
    ({"scheme.surface.k1": {"around": "20 %"}}, "is a setting of the law or simulation"),
    ({"simulation.period": {"around": "20 %"}}, "is a setting of the law or simulation"),
    ({"file": "nothing.yaml"}, "cannot read"),
    ({"robot.plant.masses": {"ball": -1}}, ">= 0"),
    ({"sensor.delay": {"choice": [-1]}}, ">= 0"),
    ({"robot.plant.masses": {"standard_error": [1, 2, 3]}}, "[2] numbers"),
]


@pytest.mark.parametrize(("sets", "words"), BAD)
def test_an_invalid_uncertainty_set_is_refused_in_one_line(sets, words):
    with pytest.raises(DefinitionError) as caught:
        family(sets)
    message = str(caught.value)
    assert words in message, message
    assert "uncertainty" in message and "\n" not in message


PANDA = read_description("panda-payload")


@pytest.mark.parametrize("path", ["start.q[3]", "start.q[panda_joint4]", "start.q[Panda-Joint4]", "start.q.3"])
def test_a_joints_entry_of_a_list_is_set_by_name_or_index(path):
    changed = alter_description(PANDA, {path: -1.75})
    expected = list(PANDA.start.q)
    expected[3] = -1.75
    assert changed.start.q == expected


def test_setting_one_joint_expands_a_scalar_to_all_joints():
    changed = alter_description(PANDA, {"scheme.k1": 0.5, "scheme.k1[panda_joint2]": 0.25})
    assert changed.scheme.surface.k1 == [0.5, 0.25, *[0.5] * 5]


def test_numbered_joints_are_named_by_their_numbers_from_1():
    scenario = load("example-4.1", {"start.q[joint 2]": 2.25, "start.q[0]": 0.05, "simulation.t1": 0.1})
    np.testing.assert_array_equal(scenario.state0.q, [0.05, 2.25])


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("start.q[7]", "`start.q` is a list of 7, and `7` is not an index from 0 to 6"),
        ("start.q.panda_joint4", "is not an index from 0 to 6. Write `start.q[0]`, or `start.q[JOINT]`"),
        (
            "start.q[panda_joint]",
            "`panda_joint` is not a joint of the robot, and not a number from 0 to 6; did",
        ),
        ("start.q[-1]", "`-1` is not a joint of the robot, and not a number from 0 to 6"),
        ("start.q[", "is not a path: write an entry of a list as"),
        ("start.q[0]]", "is not a path: write an entry of a list as"),
        ("start.dq[0]", "`start.dq` is not in the file, so a single entry of it cannot be set: set all entries"),
        ("start[0]", "start: unknown key `0`"),
        ("start.q[0][1]", "`start.q.0` is a single value"),
    ],
)
def test_an_invalid_index_is_refused_with_the_valid_ones(path, words):
    with pytest.raises(DefinitionError) as caught:
        alter_description(PANDA, {path: 0.1})
    assert words in str(caught.value)


def test_the_option_set_of_the_command_line_accepts_indices_in_brackets():
    result = in_process("run", "example-4.1", "--set", "start.q[0]=0.05", "--set", "simulation.t1=0.01", "--json")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("path", "column", "label"),
    [
        ("start.q", "start.q[3]", "start.q[panda_joint4]"),
        ("start.q[panda_joint4]", "start.q.3", "start.q[panda_joint4]"),
        ("robot.plant.coulomb", "robot.plant.coulomb[0]", "robot.plant.coulomb[panda_joint1]"),
        ("robot.plant.load.center", "robot.plant.load.center[2]", "robot.plant.load.center[2]"),
    ],
)
def test_the_label_of_an_uncertain_value_names_its_joint_and_is_a_valid_path(path, column, label):
    sets: Any = TypeAdapter(Uncertainty).validate_python({path: {"around": 0.01, "each": "joint"}})
    family = Family.of(PANDA, sets)
    assert family.label(column) == label
    alter_description(PANDA, {"robot.plant.coulomb": [0.5] * 7, label: 0.1})
