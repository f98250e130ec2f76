"""Scenario files: what is shipped is valid, and what is read is what was written."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import jsonschema
import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.law import Recovery
from slidax.scenarios.instruments import ActuatorDescription, LossDescription, OutageDescription, SensorDescription
from slidax.scenarios.sampled_data import SampledDataDescription
from slidax.scenarios.yaml_text import read_yaml

BUILT_IN = Path(scenarios.__file__).parent / "built_in"
DOCUMENTED = Path(__file__).parents[2] / "docs" / "scenarios.md"

PAPER = [name for name in scenarios.names() if name.startswith("example-")]
"""The others are our own."""


@pytest.mark.parametrize("name", scenarios.names())
def test_a_built_in_scenario_is_valid_by_the_published_schema(name: str) -> None:
    data = read_yaml((BUILT_IN / f"{name}.yaml").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(scenarios.schema()).validate(data)


def test_the_schema_refuses_an_unknown_key() -> None:
    data = read_yaml((BUILT_IN / "example-4.1.yaml").read_text(encoding="utf-8"))
    data["scheme"]["surfce"] = {}
    assert not jsonschema.Draft202012Validator(scenarios.schema()).is_valid(data)


@pytest.mark.parametrize("name", PAPER)
def test_the_example_follows_the_motion_that_the_paper_prints(name: str) -> None:
    t = 0.7
    printed = {
        "example-4.1": [
            1.25 - 7 / 5 * np.exp(-t) + 7 / 20 * np.exp(-4 * t),
            1.25 + np.exp(-t) - 1 / 4 * np.exp(-4 * t),
        ],
        "example-4.2": [np.sin(np.pi * t / 5), 1.5 * np.cos(np.pi * t / 5), 1 + 0.5 * np.sin(np.pi * t / 5)],
    }
    position = scenarios.load(name).trajectory.position(jnp.asarray(t))
    np.testing.assert_allclose(position, printed[name.removesuffix("-1khz")], rtol=1e-14)


@pytest.mark.parametrize("name", PAPER)
def test_the_example_is_disturbed_as_the_paper_prints(name: str) -> None:
    t = 0.3
    ripple = 0.5 * np.sin(200 * np.pi * t)
    printed = {
        "example-4.1": [2 * np.sin(t) + ripple, np.cos(2 * t) + ripple],
        "example-4.2": [np.sin(t) + 1, 2 * np.cos(t) + 0.5, 2 * np.sin(t) + 1],
    }
    scenario = scenarios.load(name)
    np.testing.assert_allclose(
        scenario.plant.disturbance(jnp.asarray(t), scenario.state0),
        printed[name.removesuffix("-1khz")],
        rtol=1e-12,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["example-4.1", "example-4.2"])
def test_at_1_khz_the_law_has_the_papers_gains_and_no_boundary_layer(name: str) -> None:
    slow, printed = scenarios.load(f"{name}-1khz"), scenarios.load(name)
    for part in ("transformation", "surface", "bound"):
        assert eqx.tree_equal(getattr(slow.controller.step, part), getattr(printed.controller, part)), part
    reaching = eqx.tree_at(lambda law: law.layer, printed.controller.reaching, jnp.zeros(()))
    assert eqx.tree_equal(slow.controller.step.reaching, reaching)
    assert eqx.tree_equal((slow.plant.robot, slow.state0), (printed.plant.robot, printed.state0))
    # 20 % heavier than the arm in both examples.
    np.testing.assert_allclose(slow.controller.nominal.masses, 1.2 * slow.plant.robot.masses, rtol=1e-15)


def test_the_nominal_robot_takes_from_the_plant_what_it_is_not_given() -> None:
    nominal = scenarios.load("example-4.1", {"robot.plant.lengths": [0.9, 0.7]}).controller.nominal
    np.testing.assert_array_equal(nominal.lengths, [0.9, 0.7])
    np.testing.assert_array_equal(nominal.masses, [0.6, 1.8])


def test_a_file_is_read_like_a_built_in_scenario(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text((BUILT_IN / "example-4.1.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    scenario = scenarios.load(file, {"simulation.t1": 0.01})
    assert scenario.name == "mine"
    assert scenario.simulate().outcome.ok


def test_the_scenario_in_the_documentation_runs_inside_its_envelope() -> None:
    text = DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    assert scenarios.parse(text).build("documented").simulate(log_every=None).outcome.ok


def test_the_documented_sensor_actuator_and_sampled_data_fit_the_documented_scenario() -> None:
    blocks = DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n")
    (at_rate,) = (block for block in blocks if block.startswith("sensor:"))
    scenario, rate = blocks[1].split("```")[0], read_yaml(at_rate.split("```")[0])
    assert list(rate) == ["sensor", "actuator", "scheme", "simulation"]
    own = rate.pop("scheme")["sampled_data"]
    built = scenarios.parse(scenario, rate | {"scheme.sampled_data": own}).build("documented")
    # What the page says of leaving the recovery out.
    assert eqx.tree_equal(built.controller.step.recovery, Recovery())
    run = built.simulate(log_every=None)
    assert run.outcome.ok, run.outcome.message
    assert int(run.tally.violations) == 0
    # Without the form, the same law with the same sensor is lost.
    printed = scenarios.parse(scenario, rate).build("printed").simulate(log_every=None)
    assert printed.outcome.kind == "not_finite"


def test_every_field_of_the_sensor_and_the_actuator_is_documented() -> None:
    text = DOCUMENTED.read_text(encoding="utf-8")
    section = text[text.index("## At the rate of a robot") :]
    for model in (SensorDescription, ActuatorDescription, LossDescription, OutageDescription, SampledDataDescription):
        for field in model.model_fields:
            assert f"`{field}`" in section or f"`loss.{field}`" in section or field == "loss", field
    for kind in scenarios.catalogue()["estimators"]:
        assert f"- `{kind}`" in section


def test_numbers_with_an_exponent_are_numbers_in_yaml_1_2() -> None:
    assert read_yaml("1e-4") == 1e-4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2", "not valid YAML at line"),
        ("- 1\n- 2", "a scenario is a mapping with the keys title"),
        ("title: only this", "robot: is missing"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused_in_one_sentence(text: str, words: str) -> None:
    with pytest.raises(DefinitionError, match=words):
        scenarios.parse(text)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "picture.yaml"
    file.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(DefinitionError, match="not UTF-8"):
        scenarios.load(file)
