"""What is not known of a scenario: sets of values by path, drawn from the unit cube; its law knows nothing of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from scipy import stats

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.scenarios.family import Family

NAME = "example-4.1-1khz"
CUBE = np.random.default_rng(3).random((4000, 2))


def family(sets: dict[str, Any], name: str = NAME, **changes: Any) -> Family:
    return Family.of(scenarios.load(name, {"uncertainty": sets, **changes}).description)


def drawn(path: str, one: dict[str, Any], name: str = NAME) -> np.ndarray:
    found = family({path: one}, name)
    cube = np.random.default_rng(3).random((4000, found.space.dimensions))
    return found.space.values(cube)[path]


def fits(values: np.ndarray, distribution: Any) -> bool:
    """Kolmogorov and Smirnov's test, which 4000 values of another distribution do not pass."""
    return bool(stats.kstest(values, distribution).pvalue > 1e-3)


def test_between_is_uniform_unless_another_distribution_is_named() -> None:
    between = {"between": [0.5, 2.0]}
    assert fits(drawn("disturbance.scale", between), stats.uniform(0.5, 1.5).cdf)
    log = drawn("disturbance.scale", {**between, "distribution": "log_uniform"})
    assert fits(log, stats.loguniform(0.5, 2.0).cdf)
    assert not fits(log, stats.uniform(0.5, 1.5).cdf)
    peak = drawn("disturbance.scale", {**between, "distribution": "triangular"})
    assert fits(peak, stats.triang(0.5, 0.5, 1.5).cdf)
    normal = drawn("disturbance.scale", {**between, "distribution": "normal", "mean": 1.0, "deviation": 0.5})
    assert fits(normal, stats.truncnorm(-1.0, 2.0, 1.0, 0.5).cdf)


def test_around_takes_a_share_of_the_own_value_or_a_distance() -> None:
    share = drawn("robot.plant.masses", {"around": "20 %"})
    assert np.allclose(share.min(axis=0), [0.4, 1.2], rtol=1e-3) and np.allclose(
        share.max(axis=0), [0.6, 1.8], rtol=1e-3
    )
    # One draw for all joints: the masses stay in proportion.
    assert np.allclose(share[:, 1] / share[:, 0], 3.0)
    each = drawn("robot.plant.masses", {"around": "20 %", "each": "joint"})
    assert abs(np.corrcoef(each.T)[0, 1]) < 0.05
    assert np.ptp(drawn("start.q", {"around": 0.1})[:, 0]) == pytest.approx(0.2, rel=1e-2)


def test_one_number_for_all_joints_becomes_one_for_each_where_that_is_asked_for() -> None:
    path = "robot.plant.coulomb"
    assert drawn(path, {"between": [0.1, 0.5]}, "panda-payload").shape == (4000,)
    each = drawn(path, {"between": [0.1, 0.5], "each": "joint"}, "panda-payload")
    assert each.shape == (4000, 7)
    assert np.abs(np.corrcoef(each.T) - np.eye(7)).max() < 0.08


def test_a_ball_is_filled_evenly_in_all_directions() -> None:
    found = drawn("robot.plant.load.center", {"ball": 0.05}, "panda-payload") - np.array([0.0, 0.0, 0.1])
    far = np.linalg.norm(found, axis=1) / 0.05
    assert far.max() < 1.0
    assert fits(far**3, "uniform")
    assert np.abs(found.mean(axis=0)).max() < 0.002
    on = drawn("robot.plant.load.center", {"ball": 0.05, "distribution": "surface"}, "panda-payload")
    assert np.allclose(np.linalg.norm(on - np.array([0.0, 0.0, 0.1]), axis=1), 0.05)


def test_a_choice_keeps_its_weights_and_a_seed_may_be_any() -> None:
    found = drawn("sensor.delay", {"choice": [1, 2, 5], "weights": [1, 2, 1]})
    values, counts = np.unique(found, return_counts=True)
    assert values.tolist() == [1, 2, 5]
    assert np.allclose(counts / 4000, [0.25, 0.5, 0.25], atol=0.03)
    seeds = drawn("sensor.seed", {"choice": "any"})
    assert seeds.dtype.kind == "i" and len(np.unique(seeds)) > 3990


def test_starts_are_inside_the_envelope_and_reach_its_share() -> None:
    found = family({"start": {"inside": "envelope", "share": 0.5}})
    q = found.space.values(CUBE)["start.q"]
    loaded = scenarios.load(NAME)
    t = jax.numpy.zeros(())
    e = q - np.asarray(loaded.trajectory.position(t))
    # rho0 of .8 and .6 above, and below times 1, with an overshoot of .2: the interval is (-.2 rho0, rho0) or turned.
    half, middle = np.ptp(e, axis=0) / 2, (e.max(axis=0) + e.min(axis=0)) / 2
    assert np.allclose(half, 0.5 * 0.5 * 1.2 * np.array([0.8, 0.6]), rtol=1e-2)
    assert np.allclose(np.abs(middle), 0.4 * np.array([0.8, 0.6]), rtol=2e-2)


def test_the_law_never_sees_what_is_uncertain() -> None:
    sets = {
        "robot.plant.mass_factor": {"around": "20 %"},
        "robot.plant.load.mass": {"between": [0.5, 3]},
        "sensor.delay": {"choice": [3]},
        "actuator.torque": {"choice": [[80, 80, 80, 80, 11, 11, 11]]},
        "robot.nominal.armature": {"choice": [0.02]},
    }
    sets.pop("actuator.torque")
    found = family(sets, "panda-payload")
    values = {path: array[0] for path, array in found.space.values(np.full((1, found.space.dimensions), 0.9)).items()}
    case, own = found.scenario(values, "case"), scenarios.load("panda-payload")
    leaves = [jax.tree.leaves(one.controller) for one in (case, own)]
    assert all(np.array_equal(a, b) for a, b in zip(*leaves, strict=True))
    assert float(case.plant.load.payload.mass) == pytest.approx(2.75)
    assert case.plant.sensor.periods == 3.0
    assert np.allclose(case.plant.robot.armature, 0.02)
    # The same values by `--set` do tell the law.
    told = scenarios.load("panda-payload", {"sensor.delay": 3, "robot.nominal.armature": 0.02})
    assert not all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(told.controller), leaves[1], strict=False))


def test_what_identify_writes_can_be_used_as_it_stands(tmp_path: Path) -> None:
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
    found = Family.of(scenarios.load("panda-payload", changes).description)
    values = found.space.values(np.random.default_rng(0).random((2000, found.space.dimensions)))
    rotors = values["robot.nominal.armature"]
    assert rotors[:, 0].std() == pytest.approx(0.01, rel=0.05) and rotors[:, 0].max() <= 0.1301
    # A rotor has no inertia below zero, however wide the estimate.
    assert rotors[:, 4].min() == 0.0
    assert values["robot.plant.coulomb"].mean() == pytest.approx(0.4, abs=0.01)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"robot.plant.mases": {"around": "20 %"}}, "did you mean `masses`"),
    ({"robot.plan.masses": {"around": "20 %"}}, "did you mean `plant`"),
    ({"robot.kind": {"choice": [1]}}, "is not a number"),
    ({"robot.plant": {"choice": [1]}}, "is not a number"),
    ({"disturbance.terms.7.amplitude": {"around": 1}}, "leads nowhere"),
    ({"robot.plant.masses": {"around": "20"}}, "20 %"),
    ({"robot.plant.masses": {"around": -1}}, ">= 0"),
    ({"robot.plant.masses": {"around": "150 %"}}, "must be > 0"),
    ({"robot.plant.masses": {"between": [1, 0]}}, "is empty"),
    ({"robot.plant.masses": {"between": [1]}}, ">= 2 entries"),
    ({"robot.plant.masses": {"between": [0.5, [1, 2, 3]]}}, "[2] numbers"),
    ({"disturbance.scale": {"between": [0, 1], "distribution": "log_uniform"}}, "ends > 0"),
    ({"disturbance.scale": {"between": [0, 1], "mean": 0.5}}, "belong to `normal`"),
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
    ({"disturbance.scale": {"inside": "envelope"}}, "is for `start`"),
    ({"start": {"inside": "envelope", "share": 1.5}}, "< 1"),
    ({"start": {"inside": "box"}}, "envelope"),
    ({"scheme.surface.k1": {"around": "20 %"}}, "what the law is told"),
    ({"simulation.period": {"around": "20 %"}}, "what the law is told"),
    ({"file": "nothing.yaml"}, "cannot read"),
    ({"robot.plant.masses": {"ball": -1}}, ">= 0"),
    ({"sensor.delay": {"choice": [-1]}}, ">= 0"),
    ({"robot.plant.masses": {"standard_error": [1, 2, 3]}}, "[2] numbers"),
]


@pytest.mark.parametrize(("sets", "said"), BAD)
def test_a_bad_set_is_one_line_that_names_the_path_before_anything_runs(sets: dict[str, Any], said: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        family(sets)
    message = str(caught.value)
    assert said in message, message
    assert "uncertainty" in message and "\n" not in message
