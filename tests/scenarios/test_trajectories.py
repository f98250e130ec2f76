"""Trajectories within limits, from files, by named joints and as tool paths."""

import json
import warnings
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from slidax import scenarios
from slidax.arms import JointLimits
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.motions import AbstractMotion, Circle, Line, MinimumJerk, Tabulated, Trapezoidal, follow
from slidax.scenarios import Scenario, draft, load, parse
from slidax.scenarios.load import portable_text, restore
from slidax.scenarios.trajectories import TrajectoryDescription, warn_of_units
from slidax.scenarios.yaml_text import as_yaml, read_yaml
from tests.arms.kinematics.postures import home

PATH = [[-0.4, 2.5], [0.2, 2.0], [0.1, 2.2]]
CSV = "time,elbow,shoulder\n0,2.5,-0.4\n1,2.0,0.2\n2.5,2.2,0.1\n"
ROS_MESSAGE = {
    "joint_names": ["elbow", "shoulder"],
    "points": [
        {"positions": [2.5, -0.4], "time_from_start": {"sec": 0, "nanosec": 0}},
        {"positions": [2.0, 0.2], "time_from_start": {"sec": 1, "nanosec": 0}},
        {"positions": [2.2, 0.1], "time_from_start": {"sec": 2, "nanosec": 500_000_000}},
    ],
}
JOINTS = ["shoulder", "elbow"]
LIMITS = JointLimits([-1.0, -0.1], [3.0, 3.0], [2.0, 1.5], [np.inf, np.inf], [np.inf, np.inf])
THROUGH = Tabulated.through([0.0, 1.0, 2.5], PATH)
TABLE = Tabulated(THROUGH.times, THROUGH.coefficients, ("shoulder", "elbow"))


def described(trajectory: dict[str, Any]) -> Any:
    return TypeAdapter(TrajectoryDescription).validate_python(trajectory)


def loaded(trajectory: dict[str, Any], **changes: Any) -> Any:
    return scenarios.load("example-4.1", {"trajectory": trajectory, "simulation.t1": 0.1} | changes)


CASES: list[tuple[dict[str, Any], AbstractMotion]] = [
    (
        {"kind": "quintic", "waypoints": PATH, "velocity": 1.0, "acceleration": [3.0, 4.0]},
        MinimumJerk.within(PATH, velocity=1.0, acceleration=[3.0, 4.0]),
    ),
    (
        {"kind": "quintic", "waypoints": PATH, "velocity": 1.0, "acceleration": 3.0, "jerk": 50.0, "start": 0.5},
        MinimumJerk.within(PATH, velocity=1.0, acceleration=3.0, jerk=50.0, start=0.5),
    ),
    (
        {"kind": "trapezoidal", "waypoints": PATH, "velocity": [1.0, 2.0], "acceleration": 3.0},
        Trapezoidal.through(PATH, velocity=[1.0, 2.0], acceleration=3.0),
    ),
    (
        {"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0, "acceleration": 3.0, "jerk": 50.0, "start": 0.5},
        Trapezoidal.through(PATH, velocity=1.0, acceleration=3.0, jerk=50.0, start=0.5),
    ),
    ({"kind": "csv", "text": CSV, "joints": JOINTS, "velocity": 2.0}, TABLE),
    ({"kind": "joint_trajectory", "text": json.dumps(ROS_MESSAGE), "joints": JOINTS, "acceleration": [30, 30]}, TABLE),
]


@pytest.mark.parametrize(("trajectory", "expected"), CASES, ids=[str(number) for number in range(len(CASES))])
def test_a_trajectory_block_builds_the_same_motion_as_python(trajectory, expected):
    scenario = loaded(trajectory)
    assert eqx.tree_equal(scenario.trajectory, expected, rtol=1e-12, atol=1e-12)
    assert scenario.simulate(log_every=None).outcome.kind in ("ok", "left_envelope")


@pytest.mark.parametrize(("kind", "content"), [("csv", CSV), ("joint_trajectory", json.dumps(ROS_MESSAGE))])
def test_a_trajectory_file_is_read_from_the_current_folder(kind, content, tmp_path, monkeypatch):
    (tmp_path / "motion.txt").write_text(content, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    built = loaded({"kind": kind, "file": "motion.txt", "joints": JOINTS}).trajectory
    assert eqx.tree_equal(built, TABLE, rtol=1e-12, atol=1e-12)
    with pytest.raises(DefinitionError, match=r"^trajectory: cannot read the file `gone.txt`"):
        loaded({"kind": kind, "file": "gone.txt"})


def test_the_value_robot_of_a_limit_stands_for_the_robots_own_limit():
    quintic = described({"kind": "quintic", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    assert eqx.tree_equal(
        quintic.build(LIMITS), MinimumJerk.within(PATH, velocity=[2.0, 1.5], acceleration=30.0), rtol=1e-12, atol=1e-12
    )
    fast = described({"kind": "trapezoidal", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    both = Trapezoidal.through(PATH, velocity=[2.0, 1.5], acceleration=30.0)
    assert eqx.tree_equal(fast.build(LIMITS), both, rtol=1e-12, atol=1e-12)
    table = {"kind": "csv", "text": CSV, "joints": JOINTS, "lower": "robot", "upper": "robot", "velocity": "robot"}
    assert eqx.tree_equal(described(table).build(LIMITS), TABLE)
    low = eqx.tree_at(lambda limits: limits.upper, LIMITS, np.array([0.1, 3.0]))
    with pytest.raises(DefinitionError, match=r"joint `shoulder` would go to .* above its limit of 0.1"):
        described(table).build(low)


def test_the_value_robot_of_a_limit_is_refused_for_a_robot_without_limits():
    quintic = described({"kind": "quintic", "waypoints": PATH, "velocity": "robot", "acceleration": 30.0})
    with pytest.raises(DefinitionError, match="velocity: is `robot`, but this robot has no limits"):
        quintic.build()


@pytest.mark.parametrize(
    ("trajectory", "words"),
    [
        ({"kind": "csv"}, "trajectory: needs either `file` or `text`"),
        ({"kind": "csv", "file": "a.csv", "text": CSV}, "trajectory: needs either `file` or `text`"),
        ({"kind": "joint_trajectory", "text": "joint_names: []"}, r"trajectory\.text: must be a JSON object"),
        (
            {"kind": "csv", "text": "time,joint 2,joint 1\n0,1,0\n1,1,x"},
            "trajectory: the text, line 3, column `joint 1`: `x` is not a number",
        ),
        ({"kind": "csv", "text": "time,a\n0,0\n1,1"}, "trajectory: the text moves 1 joint, `a`, but the robot has 2"),
        (
            {"kind": "csv", "text": CSV, "joints": ["elbow"]},
            r"trajectory\.joints: must have one name for each of the robot's 2 joints, `joint 1`, `joint 2`; got 1",
        ),
        (
            {"kind": "csv", "text": "time,joint 1,joint 2\n0,0,0\n1,0,0", "joints": ["joint 2", "joint 1"]},
            r"trajectory\.joints: `joint 1` is at the position of the robot's joint `joint 2`",
        ),
        (
            {"kind": "quintic", "waypoints": PATH, "velocity": "fast", "acceleration": 1.0},
            r"trajectory\.velocity: must be a number or a list of numbers; got 'fast'",
        ),
        (
            {"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0, "acceleration": -1.0},
            "trajectory: `Trapezoidal.acceleration` must be > 0; got -1 for joint 1",
        ),
        ({"kind": "trapezoidal", "waypoints": PATH, "velocity": 1.0}, r"trajectory\.acceleration: is missing"),
    ],
)
def test_an_invalid_trajectory_is_refused_with_its_path(trajectory, words):
    with pytest.raises(DefinitionError, match=words):
        loaded(trajectory)


def test_a_table_can_be_text_in_the_scenario_file():
    text = "kind: csv\njoints: [shoulder, elbow]\ntext: |\n  " + CSV.replace("\n", "\n  ")
    assert eqx.tree_equal(described(read_yaml(text)).build(), TABLE)


def test_an_unknown_key_of_a_trajectory_is_refused():
    with pytest.raises(ValidationError, match="unknown key `velocty`"):
        described({"kind": "csv", "text": CSV, "velocty": 1.0})


INERTIA = 'ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.005"'
LINK = f'<link name="{{}}"><inertial><origin xyz="0 0 0.15"/><mass value="2"/><inertia {INERTIA}/></inertial></link>'
JOINT = (
    '<joint name="{}" type="revolute"><origin xyz="0 0 0.3"/><parent link="{}"/><child link="{}"/><axis xyz="{}"/>'
    '<limit lower="-2.9" upper="2.9" effort="80" velocity="2.5"/></joint>'
)
ARM = [("shoulder", "0 0 1"), ("elbow", "0 1 0"), ("wrist", "0 1 0")]
AIM = {"shoulder": 0.8, "elbow": 0.3, "wrist": -0.4}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    links = ["base", "upper", "fore", "hand"]
    parts = ['<robot name="arm"><link name="base"/>', *(LINK.format(link) for link in links[1:])]
    parts += [JOINT.format(name, links[k], links[k + 1], axis) for k, (name, axis) in enumerate(ARM)]
    (folder / "arm.urdf").write_text("".join(parts) + "</robot>", encoding="utf-8")
    (folder / "arm.yaml").write_text(draft(folder / "arm.urdf", folder=folder).text, encoding="utf-8")
    return folder / "arm.yaml"


def message(*joints: str, at: tuple[float, ...] = (0.0, 2.0)) -> dict[str, Any]:
    aims = AIM | {"finger1": 0.04}
    points = [{"positions": [0.0] * len(joints), "time_from_start": at[0]}]
    points += [{"positions": [aims[name] for name in joints], "time_from_start": at[1]}]
    return {"joint_names": list(joints), "points": points}


def loaded_on(arm: Path, /, **trajectory: Any) -> Scenario:
    return load(arm, {"trajectory": trajectory, "simulation.t1": 3.0})


def ends_of(scenario: Scenario) -> list[float]:
    return [round(float(q), 9) for q in scenario.trajectory.position(jnp.asarray(3.0))]


@pytest.mark.parametrize("joints", [("elbow", "shoulder", "wrist"), ("wrist", "elbow", "shoulder")])
def test_a_trajectory_file_may_list_its_joints_in_any_order(file, joints):
    motion = message(*joints)
    rows = [",".join(["time", *joints]), *(",".join(map(str, [t, *p])) for t, p in _rows(motion))]
    echoed = file.parent / "echoed.yaml"
    echoed.write_text(_yaml(motion) + "---\n", encoding="utf-8")
    for trajectory in (
        {"kind": "joint_trajectory", "text": json.dumps(motion)},
        {"kind": "joint_trajectory", "file": str(echoed)},
        {"kind": "csv", "text": "\n".join(rows)},
    ):
        assert ends_of(loaded_on(file, **trajectory)) == list(AIM.values())


def test_the_motion_of_a_gripper_finger_is_omitted_with_a_warning_that_names_it(file):
    motion = json.dumps(message("finger1", "shoulder", "elbow", "wrist"))
    with pytest.warns(DefinitionWarning, match="`finger1` is not a joint of the robot and is left out"):
        assert ends_of(loaded_on(file, kind="joint_trajectory", text=motion)) == list(AIM.values())


def test_missing_joints_are_refused_with_their_names_and_the_remedy_works(file):
    text = "time,wrist,j1,j2\n0,0,0,0\n2,-0.4,0.8,0.3\n"
    with pytest.raises(DefinitionError, match=r"lacks the joints `shoulder`, `elbow`; there are: `wrist`, `j1`, `j2`"):
        loaded_on(file, kind="csv", text=text)
    assert ends_of(loaded_on(file, kind="csv", text=text, joints=["j1", "j2", "wrist"])) == list(AIM.values())


def test_a_motion_in_milliseconds_causes_a_warning_whose_remedy_works(file):
    rows = [[0, 0, 0, 0], [2000, *AIM.values()]]
    text = "\n".join(["time,shoulder,elbow,wrist", *(",".join(map(str, row)) for row in rows)])
    with pytest.warns(DefinitionWarning, match=r"lasts 2000 s, but the run ends at 3 s: are its times in ms\?"):
        assert ends_of(loaded_on(file, kind="csv", text=text)) != list(AIM.values())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ends_of(loaded_on(file, kind="csv", text=text, time_unit="ms")) == list(AIM.values())
        loaded_on(file, kind="csv", text=text, time_unit="s")


def test_a_tool_path_in_milliseconds_causes_a_warning():
    path = {"kind": "tool_path", "start": [0.0], "text": "time,x,y,z\n0,0,0,0\n2000,1,0,0\n"}
    described = TypeAdapter(TrajectoryDescription).validate_python(path)
    with pytest.warns(DefinitionWarning, match=r"in ms\? Then call their column `time \[ms\]`"):
        warn_of_units(described, Tabulated.through([0.0, 2000.0], [[0.0], [1.0]]), 3.0)


def test_a_joint_trajectory_message_in_nanoseconds_causes_a_warning(file):
    motion = json.dumps(message("shoulder", "elbow", "wrist", at=(0, 2_000_000_000)))
    with pytest.warns(DefinitionWarning, match=r"the text lasts 2e\+09 s.*are its times in ns\?"):
        loaded_on(file, kind="joint_trajectory", text=motion)


def test_a_motion_in_another_joint_order_is_refused_with_a_remedy_that_works(file):
    scenario = loaded_on(file, kind="joint_trajectory", text=json.dumps(message("shoulder", "elbow", "wrist")))
    motion = Tabulated.from_joint_trajectory(message("wrist", "shoulder", "elbow"))
    with pytest.raises(DefinitionError, match=r"are `wrist`, `shoulder`, `elbow`, but the robot's order is .*joints="):
        scenario.replace(trajectory=motion).simulate(progress=False)
    again = Tabulated.from_joint_trajectory(
        message("wrist", "shoulder", "elbow"), joints=scenario.plant.robot.joint_names
    )
    np.testing.assert_array_equal(again.coefficients, scenario.trajectory.coefficients)


def _rows(motion: dict[str, Any]) -> list[tuple[float, list[float]]]:
    return [(point["time_from_start"], point["positions"]) for point in motion["points"]]


def _yaml(motion: dict[str, Any]) -> str:
    lines = ["joint_names:", *(f"- {name}" for name in motion["joint_names"]), "points:"]
    for time, positions in _rows(motion):
        lines += ["- positions:", *(f"  - {q}" for q in positions), "  velocities: []", "  time_from_start:"]
        lines += [f"    sec: {int(time)}", "    nanosec: 0"]
    return "\n".join(lines) + "\n"


TEXT = """
title: A circle
robot: {kind: panda}
trajectory:
  kind: tool_path
  start: %s
  velocity: robot
  acceleration: 7
  moves:
    - {kind: line, by: [0.05, 0, 0]}
    - {kind: circle, center: [0.357, 0.1, 0.59], axis: [0, 0, 1], speed: 0.2, acceleration: 1.0}
start: {q: %s}
scheme:
  name: cftsmppc
  performance: {kind: fixed_time, initial: 0.1, final: 0.01, deadline: 1.0, exponent: 2.01}
  overshoot: 0.5
  sampled_data: {}
simulation: {period: 1e-3, t1: 0.02}
""" % ((home("panda").tolist(),) * 2)


def test_a_tool_path_equals_the_motion_of_follow_and_survives_a_yaml_round_trip():
    built = parse(TEXT).build("circle")
    arm = built.plant.robot
    followed = follow(
        arm,
        [Line(by=[0.05, 0, 0]), Circle(center=[0.357, 0.1, 0.59], axis=[0, 0, 1], speed=0.2, acceleration=1.0)],
        start=home("panda"),
        velocity=np.asarray(arm.limits.velocity),
        acceleration=7.0,
    )
    np.testing.assert_array_equal(built.trajectory.coefficients, followed.trajectory.coefficients)
    again = parse(as_yaml(built.description)).build("again")
    np.testing.assert_array_equal(again.trajectory.coefficients, followed.trajectory.coefficients)
    assert built.simulate().outcome.ok


def test_a_portable_scenario_contains_its_table_of_tool_positions(tmp_path):
    place = [0.3070195700, 0.0, 0.5902695582]
    rows = "\n".join(f"{t},{place[0]},{y},{place[2]}" for t, y in ((0, 0), (0.5, 0.02), (1, 0.05)))
    (tmp_path / "tool.csv").write_text(f"time,x,y,z\n{rows}\n")
    before, after = TEXT.split("  velocity")[0], TEXT[TEXT.index("start: {q") :]
    (tmp_path / "one.yaml").write_text(f"{before}  file: tool.csv\n{after}")
    built = load(tmp_path / "one.yaml")
    there = built.plant.robot.tip(built.trajectory.position(jnp.asarray(1.0)))
    np.testing.assert_allclose(there, [place[0], 0.05, place[2]], atol=1e-6)
    again = restore(*portable_text(built.description), "again")
    np.testing.assert_array_equal(again.trajectory.coefficients, built.trajectory.coefficients)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trajectory.moves": []}, "trajectory: needs exactly one of `moves`, `file` and `text`"),
        ({"trajectory.start": [0.0, 1.0]}, "trajectory: `start` must be 7 finite numbers"),
        ({"trajectory.velocity": 0.01}, "trajectory.moves.1: panda_joint2 would need .* limit of 0.01 for velocity"),
        ({"trajectory.moves.0.kind": "spiral"}, "trajectory.moves.0.kind: unknown `spiral`"),
        ({"trajectory.hold": "all"}, "trajectory.hold: unknown `all`"),
        ({"robot": {"kind": "panda"}, "trajectory.moves.0.by": [1, 0, 0]}, "moves.0: the tool cannot follow beyond"),
    ],
)
def test_an_invalid_tool_path_is_refused_with_its_path(changes, words):
    with pytest.raises(DefinitionError, match=words):
        parse(TEXT, changes).build("wrong")
