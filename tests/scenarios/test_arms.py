"""Scenario files with arms of rigid links: the plant and the law that they build, and refused files."""

from functools import cache
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from slidax import arms as robots
from slidax import scenarios
from slidax.arms import Articulated, Payload, TimedPayload
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.plant import TorqueLimits
from slidax.scenarios import Scenario
from slidax.scenarios.robots import Arms
from slidax.simulation import MujocoPlant, Plant, Table
from tests.arms import bad_mjcf, bad_urdf

PAYLOAD = "panda-payload"
BUILT_IN = Path(scenarios.__file__).parent / "built_in"
URDF = {"kind": "urdf", "file": bad_urdf.GOOD}


@cache
def text() -> str:
    return (BUILT_IN / f"{PAYLOAD}.yaml").read_text(encoding="utf-8")


def arms(robot: dict[str, Any]) -> Arms:
    """Return the two arms without the law, whose construction would compile M."""
    return scenarios.parse(text(), {"robot": robot}).robot.build()


def scenario(**changes: Any) -> Scenario:
    return scenarios.load(PAYLOAD, {name.replace("__", "."): value for name, value in changes.items()})


def nominal(robot: dict[str, Any]) -> Articulated:
    arm = arms(robot).nominal
    assert isinstance(arm, Articulated)
    return arm


@pytest.mark.parametrize("kind", robots.built_in_names())
def test_a_built_in_robot_is_selected_by_its_name_alone(kind):
    true, known, load = arms({"kind": kind})
    assert eqx.tree_equal(known, robots.built_in_arm(kind).robot) and eqx.tree_equal(true, known)
    assert load is None


def test_a_scenario_reads_its_arm_from_a_file(tmp_path):
    urdf, mjcf = tmp_path / "arm.urdf", tmp_path / "arm.xml"
    urdf.write_text(bad_urdf.GOOD, encoding="utf-8")
    mjcf.write_text(bad_mjcf.GOOD, encoding="utf-8")
    how = {"tip": "tool", "locked": {"elbow": 0.5}}
    arm = nominal({"kind": "urdf", "file": str(urdf), **how})
    assert eqx.tree_equal(arm, robots.from_urdf(urdf, **how)) and arm.joint_names == ("shoulder",)
    arm = nominal({"kind": "mjcf", "file": str(mjcf), **how})
    assert eqx.tree_equal(arm, robots.from_mjcf(mjcf, **how)) and arm.joint_names == ("shoulder",)


def test_an_impossible_inertia_is_replaced_on_request(tmp_path):
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(bad_urdf.GOOD.replace(bad_urdf.INERTIA, bad_urdf.inertia("0.01", "0.02", "0.1")), encoding="utf-8")
    with pytest.raises(DefinitionError, match=r"inertia of link `fore` is of no rigid body.*inertias: nearest takes"):
        nominal({"kind": "urdf", "file": str(urdf)})
    with pytest.warns(DefinitionWarning, match="changed to the nearest"):
        arm = nominal({"kind": "urdf", "file": str(urdf), "inertias": "nearest"})
    np.testing.assert_allclose(np.linalg.eigvalsh(arm.inertias[1]), [0.045, 0.055, 0.1], rtol=1e-12)


def test_the_block_plant_changes_the_true_arm_and_the_block_nominal_changes_both():
    load = {"mass": 1.5, "center": [0.0, 0.1, 0.2], "inertia": [0.01, 0.02, 0.025], "attached": 0.5, "released": 2.0}
    gripper = {"mass": 0.7, "center": [0.0, 0.0, 0.05], "inertia": 0.001}
    true, known, carried = arms(
        {
            "kind": "panda",
            "nominal": {"armature": 0.1, "load": gripper, "gravity": [0.0, 3.0, -9.0]},
            "plant": {"mass_factor": 0.85, "inertia_factor": 0.8, "viscous": 0.2, "coulomb": [0.1] * 7, "load": load},
        }
    )
    panda = robots.panda()
    expected = eqx.tree_at(
        lambda arm: (arm.armature, arm.payload, arm.gravity_vector),
        panda,
        (np.full(7, 0.1), Payload(0.7, (0.0, 0.0, 0.05), 0.001), np.array([0.0, 3.0, -9.0])),
    )
    assert same_numbers(known, expected)
    mismatch = robots.Mismatch(mass_factor=0.85, inertia_factor=0.8, viscous=0.2, coulomb=[0.1] * 7)
    assert same_numbers(true, mismatch.applied(known)) and not same_numbers(true, known)
    assert eqx.tree_equal(carried, TimedPayload(Payload(1.5, (0.0, 0.1, 0.2), np.diag([0.01, 0.02, 0.025])), 0.5, 2.0))


def same_numbers(first: Articulated, other: Articulated) -> bool:
    return bool(eqx.tree_equal(*(jax.tree.map(np.asarray, arm) for arm in (first, other))))


def test_rotor_inertia_of_the_plant_alone_does_not_enter_the_nominal_model():
    true, known, _ = arms({"kind": "ur5e", "plant": {"armature": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]}})
    np.testing.assert_array_equal(true.armature, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    np.testing.assert_array_equal(known.armature, np.zeros(6))


def test_a_payload_without_release_is_carried_to_the_end():
    load = arms({"kind": "panda", "plant": {"load": {"mass": 2.0}}}).load
    assert load is not None and (float(load.attached), float(load.released)) == (0.0, np.inf)


REFUSED = [
    ({"kind": "pandda"}, r"robot.kind: unknown `pandda`; did you mean `panda`\?"),
    ({"kind": "panda", "plnt": {}}, r"robot: unknown key `plnt`; did you mean `plant`\?"),
    ({"kind": "panda", "file": "arm.urdf"}, "robot: unknown key `file`; there are: `kind`, `plant`, `nominal`"),
    ({"kind": "panda", "plant": {"masses": 1.0}}, r"robot.plant: unknown key `masses`; there are: `mass_factor`"),
    (
        {"kind": "panda", "nominal": {"mass": 0.9}},
        "robot.nominal: unknown key `mass`; there are: `armature`, `viscous`, `load`",
    ),
    ({"kind": "panda", "plant": {"load": {}}}, "robot.plant.load.mass: is missing"),
    ({"kind": "panda", "plant": {"load": {"mass": -1}}}, "robot.plant.load: `Payload.mass` must be >= 0 kg; got -1"),
    ({"kind": "panda", "plant": {"load": {"mass": 1, "center": [0, 1]}}}, r"robot.plant.load.center: .*3.* \[0, 1\]"),
    ({"kind": "panda", "plant": {"mass_factor": 0}}, "robot.plant: `Mismatch.mass_factor` must be > 0; got 0"),
    (
        {"kind": "panda", "plant": {"viscous": [0.1, 0.2]}},
        "robot.plant: `Mismatch.viscous` must be one number or one for each of the 7 joints of panda, panda_joint1, ",
    ),
    (
        {"kind": "ur5e", "nominal": {"armature": [0.1] * 7}},
        "robot.nominal.armature: must be one number or one for each of the 6 joints; got 7",
    ),
    ({"kind": "panda", "nominal": {"armature": -0.1}}, "robot.nominal.armature: must be >= 0; got -0.1"),
    ({"kind": "panda", "nominal": {"gravity": [0, -9.81]}}, "robot.nominal.gravity: .*3"),
    (
        {"kind": "panda", "nominal": {"load": {"mass": 1, "attached": 1.0}}},
        "robot.nominal.load: the law cannot know a load with `attached` or `released`; write the load under `plant`",
    ),
    (
        {"kind": "panda", "nominal": {"load": {"mass": 1, "released": 1.0}}},
        "robot.nominal.load: the law cannot know a load with `attached` or `released`; write the load under `plant`",
    ),
    (
        {"kind": "panda", "plant": {"load": {"mass": 1, "attached": 2.0, "released": 1.0}}},
        "robot.plant.load: `TimedPayload.released` must be ",
    ),
    (
        {"kind": "panda", "plant": {"load": {"mass": 1, "inertia": [0.1, 0.1, -0.1]}}},
        "robot.plant.load: `Payload.inertia` must have moments >= 0",
    ),
    ({"kind": "urdf"}, "robot.file: is missing"),
    ({"kind": "urdf", "file": "no/such.urdf"}, "robot: cannot read the robot file `no/such.urdf`"),
    ({**URDF, "tip": "tol"}, r"robot: `tip` names link `tol`.* did you mean `tool`\?"),
    (
        {**URDF, "tip": "tool", "locked": {"elbo": 0.0}},
        r"robot: `locked` names .*`elbo`.* did you mean `elbow`\?",
    ),
    ({**URDF, "tip": "tool", "lokced": {}}, r"robot: unknown key `lokced`; did you mean `locked`\?"),
]


@pytest.mark.parametrize(("robot", "message"), REFUSED)
def test_an_invalid_robot_is_refused_with_the_path_of_its_field(robot, message):
    with pytest.raises(DefinitionError, match=message):
        scenarios.parse(text(), {"robot": robot}).build("refused")


def test_the_plant_and_the_law_have_the_pandas_data_sheet_torque_limits():
    built = scenario()
    panda = robots.panda()
    expected = TorqueLimits(panda.limits.torque, panda.limits.torque_rate)
    assert built.plant.actuator is not None and eqx.tree_equal(built.plant.actuator.limits, expected)
    # The law gets the same limits.
    assert eqx.tree_equal(built.controller.limits, expected)
    np.testing.assert_array_equal(panda.limits.torque, [87, 87, 87, 87, 12, 12, 12])


TWO_LINK = "example-4.1-1khz"
MISFITS = [
    (
        PAYLOAD,
        {"robot": {"kind": "gen3"}},
        "actuator.rate: the robot's description has no torque rate limits; write numbers, such as `rate: 1000`",
    ),
    (
        PAYLOAD,
        {"robot": {"kind": "gen3"}, "actuator": {"torque": "robott"}},
        "actuator.torque: must be a number .* got 'robott'",
    ),
    (
        PAYLOAD,
        {"actuator": {"torque": [87.0, 87.0]}},
        "actuator.torque: must be one number or one for each of the 7 joints",
    ),
    (TWO_LINK, {"actuator": {"torque": "robot"}}, "actuator.torque: the robot's description has no torque limits"),
    (
        PAYLOAD,
        {"surroundings": {"table": {"height": 0.0}}},
        "surroundings: only MuJoCo simulates contact with surroundings: set `simulation.plant` to `mujoco`",
    ),
    (PAYLOAD, {"simulation.plant": "mujuco"}, r"simulation.plant: unknown `mujuco`; did you mean `mujoco`\?"),
    (
        PAYLOAD,
        {"surroundings": {"table": {"height": 0.0, "friction": 0.0}}},
        "surroundings: `Table.friction` must be > 0; got 0",
    ),
    (PAYLOAD, {"surroundings": {"wall": {}}}, "surroundings: unknown key `wall`; there are: `table`"),
    (
        PAYLOAD,
        {"simulation.plant": "mujoco", "robot.plant.load.inertia": [0.01, 0.02, 0.04]},
        "simulation.plant: no rigid body has this `Payload.inertia`",
    ),
    (
        TWO_LINK,
        {"simulation.plant": "mujoco"},
        r"simulation.plant: a MujocoPlant needs.*got a TwoLink",
    ),
]


@pytest.mark.parametrize(("name", "changes", "message"), MISFITS)
def test_limits_and_plants_that_do_not_fit_the_arm_are_refused(name, changes, message):
    with pytest.raises(DefinitionError, match=message):
        scenarios.load(name, changes)


def test_a_scenario_selects_the_mujoco_plant_with_or_without_a_table():
    own = scenario().plant
    assert isinstance(own, Plant)
    moved = scenario(simulation__plant="mujoco").plant
    assert eqx.tree_equal(moved, MujocoPlant.of(own))
    table = {"table": {"height": -0.2, "friction": 0.7}}
    on_a_table = scenario(simulation__plant="mujoco", simulation__friction="dry", surroundings=table).plant
    assert eqx.tree_equal(on_a_table, MujocoPlant.of(own, surroundings=Table(-0.2, 0.7), dry=True))


def test_a_warning_about_a_robot_file_names_keys_of_the_scenario(tmp_path):
    urdf = tmp_path / "arm.urdf"
    finger = bad_urdf.SPARE + bad_urdf.joint("revolute", "finger", "tool", "spare", '<mimic joint="elbow"/>')
    tip = bad_urdf.joint("fixed", "to tip", "tool", "tcp") + '<link name="tcp"/>'
    urdf.write_text(bad_urdf.GOOD.replace("</robot>", finger + tip + "</robot>"), encoding="utf-8")
    with pytest.warns(DefinitionWarning, match=r"locked: \{'finger': 0\} is assumed.*by `locked`.*by mimics: followed"):
        arm = nominal({"kind": "urdf", "file": str(urdf), "tip": "tcp"})
    assert arm.joint_names == ("shoulder", "elbow")
