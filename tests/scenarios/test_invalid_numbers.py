"""Values that look like numbers, and are not: each is refused with its field when the description is read."""

import math
import re

import numpy as np
import pytest

from slidax import DefinitionError
from slidax.scenarios import load, named_robot
from slidax.scenarios.family import Family
from slidax.scenarios.robots import IdentifiedDescription, UrdfDescription

PANDA, PAPER = "panda-payload", "example-4.1-1khz"
NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("scenario", "field", "value", "where"),
    [
        (PAPER, "simulation.t1", True, "simulation.t1"),
        (PAPER, "simulation.substeps", False, "simulation.substeps"),
        (PAPER, "simulation.t1", np.True_, "simulation.t1"),
        (PAPER, "start.q", [0.5, True], "start.q.1"),
        (PAPER, "robot.plant.masses", [True, 1.5], "robot.plant.masses.0"),
        (PAPER, "scheme.surface.k1", True, "scheme.surface.k1"),
        (PAPER, "sensor.loss", {"probability": True}, "sensor.loss.probability"),
        (PAPER, "uncertainty", {"start.q": {"around": True}}, "uncertainty.start.q.around"),
        (PAPER, "actuator.map", [[1.0, 0.0], [0.0, True]], "actuator.map.1.1"),
        (PANDA, "robot.nominal.gravity", [0.0, 0.0, True], "robot.nominal.gravity.2"),
    ],
)
def test_a_boolean_is_not_a_number(scenario, field, value, where):
    flag = "false" if value is False else "true"
    with pytest.raises(DefinitionError) as refusal:
        load(scenario, {field: value})
    assert str(refusal.value) == f"{where}: must be a number; got {flag}"


def test_a_boolean_locks_no_joint_and_a_boolean_option_stays_one(tmp_path):
    with pytest.raises(DefinitionError, match=r"locked\.wrist: must be a number; got true"):
        named_robot("tests/identify/three_link.urdf", locked={"wrist": True})
    described = UrdfDescription(kind="urdf", file="arm.urdf", meshes=True, limits=False)
    assert described.meshes and not described.limits


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize(
    ("field", "at"),
    [
        ("robot.nominal.gravity", 2),
        ("robot.nominal.zero", 0),
        ("robot.nominal.armature", 1),
        ("start.q", 0),
        ("start.dq", 3),
        ("simulation.t1", None),
        ("sensor.delay", None),
        ("robot.plant.load.mass", None),
        ("robot.plant.load.center", 1),
    ],
)
def test_a_number_that_is_not_finite_is_refused_with_its_field(field, at, value):
    sizes = {"gravity": 3, "center": 3}
    numbers = [0.0] * sizes.get(field.rpartition(".")[2], 7)
    if at is not None:
        numbers[at] = value
    with pytest.raises(DefinitionError) as refusal:
        load(PANDA, {field: value if at is None else numbers})
    assert refusal.value.where == (field if at is None else f"{field}.{at}")
    assert re.match("must be (a finite number|[<>])", refusal.value.message)


@pytest.mark.parametrize(
    ("entry", "where"),
    [
        ({"between": [0.5, 1.5], "distribution": "normal", "mean": NAN}, "mean"),
        ({"between": [0.5, 1.5], "distribution": "normal", "mean": INF}, "mean"),
        ({"between": [0.5, 1.5], "distribution": "normal", "deviation": INF}, "deviation"),
        ({"between": [NAN, 1.5]}, "between.0"),
        ({"choice": [1.0, NAN]}, "choice.1"),
        ({"standard_error": NAN}, "standard_error"),
    ],
)
def test_a_set_of_values_is_finite(entry, where):
    with pytest.raises(DefinitionError) as refusal:
        load(PAPER, {"uncertainty": {"disturbance.scale": entry}})
    assert refusal.value.where == f"uncertainty.disturbance.scale.{where}"
    assert "must be a finite number" in refusal.value.message


@pytest.mark.parametrize("share", ["2_0 %", "nan %", "inf %", "\uff12 %"])
def test_a_share_is_a_plain_number(share):
    with pytest.raises(DefinitionError, match="must be a number, or a share"):
        load(PAPER, {"uncertainty": {"disturbance.scale": {"around": share}}})


def test_infinity_still_means_no_limit():
    drive = load(PAPER, {"actuator.torque": [INF, 50.0], "actuator.rate": INF}).description.actuator
    assert drive.torque == [INF, 50.0] and drive.rate == INF


@pytest.mark.parametrize(
    ("line", "options", "message"),
    [
        ("file: 3", {}, "robot.file: must be the name of a file; got 3"),
        ("file: arm.urdf, locked: 3", {"locked": {"wrist": 0.0}}, "robot.locked: must be a mapping; got 3"),
        ("file: arm.urdf, locked: null", {"locked": {"wrist": 0.0}}, "robot.locked: must be a mapping; got None"),
        ("file: arm.urdf, nominal: 3", {"gravity": [0.0, 0.0, -9.81]}, "robot.nominal: must be a mapping; got 3"),
    ],
)
def test_a_field_of_a_robot_file_with_the_wrong_type_is_named(tmp_path, line, options, message):
    path = tmp_path / "arm.yaml"
    path.write_text(f"robot: {{kind: urdf, {line}}}\n")
    with pytest.raises(DefinitionError) as refusal:
        named_robot(str(path), **options)
    assert str(refusal.value) == message


def test_an_identified_robot_file_with_a_nan_is_refused_with_its_field(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("robot: {kind: panda, nominal: {zero: [.nan, 0, 0, 0, 0, 0, 0]}}\n")
    with pytest.raises(DefinitionError, match=r"`robot\.nominal\.zero\.\S*0` of the file .*: must be a finite number"):
        IdentifiedDescription(kind="identified", file=str(path)).resolved()


@pytest.mark.parametrize("index", ["\u00b2", "\u0663", "9" * 5000])
def test_an_index_that_is_no_integer_is_refused(index):
    for path in (f"start.q.{index}", f"disturbance.scale.{index}"):
        with pytest.raises(DefinitionError, match="does not exist in"):
            Family.of(load(PAPER, {"uncertainty": {path: {"around": 0.1}}}).description)
    with pytest.raises(DefinitionError):
        load(PAPER, {f"start.q.{index}": 0.1})
