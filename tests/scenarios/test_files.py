"""Scenario files: shipped scenarios are valid, relative paths are resolved, and replaced parts take effect."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import jsonschema
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.law import ComputedTorque, Recovery, sampled_data
from slidax.scenarios.instruments import ActuatorDescription, LossDescription, OutageDescription, SensorDescription
from slidax.scenarios.sampled_data import SampledDataDescription
from slidax.scenarios.yaml_text import read_yaml
from slidax.simulation import native_engine
from tests.enrolled import assert_same_numbers

BUILT_IN = Path(scenarios.__file__).parent / "built_in"
DOCUMENTED = Path(__file__).parents[2] / "docs" / "scenarios.md"

PAPER = [name for name in scenarios.names() if name.startswith("example-")]
"""The scenarios of the paper's examples."""


@pytest.mark.parametrize("name", scenarios.names())
def test_a_built_in_scenario_is_valid_by_the_published_schema(name):
    data = read_yaml((BUILT_IN / f"{name}.yaml").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(scenarios.schema()).validate(data)


def test_the_schema_refuses_an_unknown_key():
    data = read_yaml((BUILT_IN / "example-4.1.yaml").read_text(encoding="utf-8"))
    data["scheme"]["surfce"] = {}
    assert not jsonschema.Draft202012Validator(scenarios.schema()).is_valid(data)


TIMES = np.linspace(0.0, 10.0, 101)


@pytest.mark.parametrize("name", PAPER)
def test_a_paper_example_has_the_trajectory_of_the_paper(name):
    t = TIMES
    printed = {
        "example-4.1": [
            1.25 - 7 / 5 * np.exp(-t) + 7 / 20 * np.exp(-4 * t),
            1.25 + np.exp(-t) - 1 / 4 * np.exp(-4 * t),
        ],
        "example-4.2": [np.sin(np.pi * t / 5), 1.5 * np.cos(np.pi * t / 5), 1 + 0.5 * np.sin(np.pi * t / 5)],
    }
    position = jax.vmap(scenarios.load(name).trajectory.position)(jnp.asarray(t))
    np.testing.assert_allclose(position.T, printed[name.removesuffix("-1khz")], atol=1e-14)


@pytest.mark.parametrize("name", PAPER)
def test_a_paper_example_has_the_disturbance_of_the_paper(name):
    t = TIMES
    ripple = 0.5 * np.sin(200 * np.pi * t)
    printed = {
        "example-4.1": [2 * np.sin(t) + ripple, np.cos(2 * t) + ripple],
        "example-4.2": [np.sin(t) + 1, 2 * np.cos(t) + 0.5, 2 * np.sin(t) + 1],
    }
    scenario = scenarios.load(name)
    forces = jax.vmap(lambda t: scenario.plant.disturbance(t, scenario.state0))(jnp.asarray(t))
    np.testing.assert_allclose(forces.T, printed[name.removesuffix("-1khz")], atol=1e-11)


@pytest.mark.parametrize("name", ["example-4.1", "example-4.2"])
def test_law_at_1_khz_has_the_papers_gains_and_no_boundary_layer(name):
    slow, printed = scenarios.load(f"{name}-1khz"), scenarios.load(name)
    for part in ("transformation", "surface", "bound"):
        assert eqx.tree_equal(getattr(slow.controller.step, part), getattr(printed.controller, part)), part
    reaching = eqx.tree_at(lambda law: law.layer, printed.controller.reaching, jnp.zeros(()))
    assert eqx.tree_equal(slow.controller.step.reaching, reaching)
    assert eqx.tree_equal((slow.plant.robot, slow.state0), (printed.plant.robot, printed.state0))
    # 20 % heavier than the arm in both examples.
    np.testing.assert_allclose(slow.controller.nominal.masses, 1.2 * slow.plant.robot.masses, rtol=1e-15)


def test_missing_values_of_the_nominal_robot_come_from_the_plant():
    nominal = scenarios.load("example-4.1", {"robot.plant.lengths": [0.9, 0.7]}).controller.nominal
    np.testing.assert_array_equal(nominal.lengths, [0.9, 0.7])
    np.testing.assert_array_equal(nominal.masses, [0.6, 1.8])


def test_a_file_is_read_like_a_built_in_scenario(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text((BUILT_IN / "example-4.1.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    scenario = scenarios.load(file, {"simulation.t1": 0.01})
    assert scenario.name == "mine" and scenario.simulate().outcome.ok


def test_the_scenario_in_the_documentation_runs_inside_its_envelope():
    text = DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    assert scenarios.parse(text).build("documented").simulate(log_every=None).outcome.ok


def test_the_documented_sensor_actuator_and_sampled_data_blocks_run_inside_the_envelope():
    blocks = DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n")
    (at_rate,) = (block for block in blocks if block.startswith("sensor:"))
    scenario, rate = blocks[1].split("```")[0], read_yaml(at_rate.split("```")[0])
    assert list(rate) == ["sensor", "actuator", "scheme", "simulation"]
    own = rate.pop("scheme")["sampled_data"]
    built = scenarios.parse(scenario, rate | {"scheme.sampled_data": own}).build("documented")
    assert eqx.tree_equal(built.controller.step.recovery, Recovery())
    run = built.simulate(log_every=None)
    assert run.outcome.ok, run.outcome.message
    assert int(run.tally.violations) == 0
    # Without its sampled-data form, the same law with the same sensor diverges.
    printed = scenarios.parse(scenario, rate).build("printed").simulate(log_every=None)
    assert printed.outcome.kind == "not_finite"


def test_every_field_of_the_sensor_and_the_actuator_is_documented():
    text = DOCUMENTED.read_text(encoding="utf-8")
    section = text[text.index("## At the rate of a robot") :]
    for model in (SensorDescription, ActuatorDescription, LossDescription, OutageDescription, SampledDataDescription):
        for field in model.model_fields:
            assert f"`{field}`" in section or f"`loss.{field}`" in section or field == "loss", field
    for kind in scenarios.catalogue()["estimators"]:
        assert f"- `{kind}`" in section


def test_numbers_with_an_exponent_are_numbers_in_yaml_1_2():
    assert read_yaml("1e-4") == 1e-4


@pytest.mark.parametrize(
    ("text", "line"), [("]", 1), ("title: one\nrobot: ]\nstart: {}\n", 2)], ids=["first", "second"]
)
def test_yaml_that_cannot_be_read_is_refused_with_its_line(text, line):
    with pytest.raises(DefinitionError, match=f"^not valid YAML at line {line}: "):
        scenarios.parse(text)


URDF = """<robot name="one">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
</robot>"""

SCENARIO = """
title: One joint from a file beside this one
robot: {kind: urdf, file: arms/one.urdf}
trajectory: {kind: csv, file: motions/turn.csv}
start: {q: [0.0]}
scheme: {name: computed_torque}
simulation: {mode: held, period: 1.0e-2, t1: 0.5}
"""


@pytest.fixture
def folder(tmp_path):
    for name, text in {
        "task/arms/one.urdf": URDF,
        "task/motions/turn.csv": "time,shoulder\n0,0\n0.25,0.1\n0.5,0.2\n",
        "task/one.yaml": SCENARIO,
        "elsewhere/arms/one.urdf": URDF.replace('mass value="2"', 'mass value="3"'),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def mass(scenario: scenarios.Scenario) -> float:
    return float(np.asarray(scenario.plant.robot.masses)[0])


def test_relative_paths_in_a_scenario_file_start_at_its_folder(folder, monkeypatch):
    monkeypatch.chdir(folder / "elsewhere")
    assert mass(scenarios.load(folder / "task" / "one.yaml")) == 2.0
    assert mass(scenarios.load(Path("..") / "task" / "one.yaml")) == 2.0


def test_relative_paths_in_an_override_start_at_the_current_folder(folder, monkeypatch):
    monkeypatch.chdir(folder / "elsewhere")
    changed = scenarios.load(folder / "task" / "one.yaml", {"robot.file": "arms/one.urdf"})
    assert mass(changed) == 3.0


def test_a_missing_robot_file_is_reported_with_its_folder(folder):
    (folder / "task" / "arms" / "one.urdf").unlink()
    with pytest.raises(DefinitionError, match=r"^robot: .*task/arms/one.urdf"):
        scenarios.load(folder / "task" / "one.yaml")


BASE = scenarios.load("example-4.1").replace(t1=0.05, mode="held", period=1e-3)
GAINS = jnp.array([0.1, 0.3])


def with_gain(scenario, k1):
    return scenario.replace(controller=eqx.tree_at(lambda c: c.surface.k1, scenario.controller, k1))


def test_load_does_not_modify_the_callers_mapping_of_changes():
    changes = {"start": {"q": [0.1, 0.2], "dq": [0.0, 0.0]}, "start.q[0]": 0.3}
    start = scenarios.load("example-4.1-1khz", changes).state0
    assert changes == {"start": {"q": [0.1, 0.2], "dq": [0.0, 0.0]}, "start.q[0]": 0.3}
    np.testing.assert_array_equal(start.q, [0.3, 0.2])


def test_scenario_replace_returns_a_copy_that_differs_only_in_the_named_fields():
    before = scenarios.load("example-4.1")
    after = before.replace(state0=State([0.3, 2.4]), t1=0.05, period=1e-3, mode="held")
    assert (after.t1, after.period, after.stepping.mode) == (0.05, 1e-3, "held")
    assert (before.t1, before.stepping.mode) == (10.0, "continuous")
    assert after.controller is before.controller and after.stepping.integrator is before.stepping.integrator
    assert after.changed == ("state0", "t1", "period", "mode") and int(after.simulate().tally.samples) == 51


def test_a_replaced_controller_gives_its_name_to_the_scheme():
    nominal = BASE.controller.nominal
    torque = ComputedTorque(nominal, kp=100.0, kd=20.0)
    assert BASE.replace(controller=torque).scheme == "ComputedTorque"
    sampled = sampled_data(torque, period=1e-3)
    assert BASE.replace(controller=sampled).scheme == "ComputedTorque"
    assert BASE.replace(controller=BASE.controller).scheme == BASE.scheme
    assert BASE.replace(controller=torque, scheme="mine").scheme == "mine"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"state0": State([0.0])}, "`state0.q` must have one entry for each of the 2 joints"),
        ({"controler": None}, r"a scenario has no field `controler`; did you mean `controller`\?"),
    ],
)
def test_scenario_replace_refuses_unfitting_parts_and_unknown_fields(change, message):
    with pytest.raises(DefinitionError, match=message):
        BASE.replace(**change)


def test_a_batch_of_scenarios_equals_single_runs():
    runs = BASE.simulate_batch(with_gain, GAINS, log_every=1)
    for run, k1 in zip(runs, GAINS, strict=True):
        alone = with_gain(BASE, k1).simulate(log_every=1)
        assert_same_numbers(run, alone)
    assert np.any(runs[0].tally.last_torque != runs[1].tally.last_torque)


def test_a_repeated_batch_is_compiled_only_once():
    BASE.simulate_batch(with_gain, GAINS, log_every=1)
    before = native_engine._compiled_batch.cache_info().misses
    BASE.simulate_batch(with_gain, GAINS, log_every=1)
    assert native_engine._compiled_batch.cache_info().misses == before


def test_a_batch_of_runs_with_different_durations_is_refused():
    with pytest.raises(DefinitionError, match="all runs of a batch must have the same `t1` and stepping"):
        BASE.simulate_batch(lambda scenario, k1: with_gain(scenario, k1).replace(t1=0.1), GAINS)
