"""Motions whose files name the joints, in the order of another program."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import TypeAdapter

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.motions import Tabulated
from slidax.scenarios import Scenario, draft, load
from slidax.scenarios.trajectories import TrajectoryDescription, warn_of_units

INERTIA = 'ixx="0.03" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.005"'
LINK = f'<link name="{{}}"><inertial><origin xyz="0 0 0.15"/><mass value="2"/><inertia {INERTIA}/></inertial></link>'
JOINT = (
    '<joint name="{}" type="revolute"><origin xyz="0 0 0.3"/><parent link="{}"/><child link="{}"/><axis xyz="{}"/>'
    '<limit lower="-2.9" upper="2.9" effort="80" velocity="2.5"/></joint>'
)
ARM = [("shoulder", "0 0 1"), ("elbow", "0 1 0"), ("wrist", "0 1 0")]
AIM = {"shoulder": 0.8, "elbow": 0.3, "wrist": -0.4}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def loaded(arm: Path, /, **trajectory: Any) -> Scenario:
    return load(arm, {"trajectory": trajectory, "simulation.t1": 3.0})


def ends_of(scenario: Scenario) -> list[float]:
    return [round(float(q), 9) for q in scenario.trajectory.position(jnp.asarray(3.0))]


@pytest.mark.parametrize("joints", [("elbow", "shoulder", "wrist"), ("wrist", "elbow", "shoulder")])
def test_each_joint_does_its_own_motion_in_any_order(file: Path, joints: tuple[str, ...]) -> None:
    given = message(*joints)
    rows = [",".join(["time", *joints]), *(",".join(map(str, [t, *p])) for t, p in _rows(given))]
    echoed = file.parent / "echoed.yaml"
    echoed.write_text(_yaml(given) + "---\n", encoding="utf-8")
    for trajectory in (
        {"kind": "joint_trajectory", "text": json.dumps(given)},
        {"kind": "joint_trajectory", "file": str(echoed)},
        {"kind": "csv", "text": "\n".join(rows)},
    ):
        assert ends_of(loaded(file, **trajectory)) == list(AIM.values())


def test_a_finger_is_left_out_with_a_warning_that_names_it(file: Path) -> None:
    given = json.dumps(message("finger1", "shoulder", "elbow", "wrist"))
    with pytest.warns(DefinitionWarning, match="`finger1` is not a joint of the robot and is left out"):
        assert ends_of(loaded(file, kind="joint_trajectory", text=given)) == list(AIM.values())


def test_missing_joints_are_refused_with_their_names_and_the_remedy_works(file: Path) -> None:
    text = "time,wrist,j1,j2\n0,0,0,0\n2,-0.4,0.8,0.3\n"
    with pytest.raises(DefinitionError, match=r"lacks the joints `shoulder`, `elbow`; there are: `wrist`, `j1`, `j2`"):
        loaded(file, kind="csv", text=text)
    assert ends_of(loaded(file, kind="csv", text=text, joints=["j1", "j2", "wrist"])) == list(AIM.values())


def test_a_motion_in_milliseconds_has_a_word_and_its_remedy_works(file: Path) -> None:
    rows = [[0, 0, 0, 0], [2000, *AIM.values()]]
    text = "\n".join(["time,shoulder,elbow,wrist", *(",".join(map(str, row)) for row in rows)])
    with pytest.warns(DefinitionWarning, match="lasts 2000 s, but the run ends at 3 s: are its times in ms?"):
        assert ends_of(loaded(file, kind="csv", text=text)) != list(AIM.values())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ends_of(loaded(file, kind="csv", text=text, time_unit="ms")) == list(AIM.values())
        loaded(file, kind="csv", text=text, time_unit="s")


def test_a_tool_path_in_milliseconds_has_a_word_too() -> None:
    path = {"kind": "tool_path", "start": [0.0], "text": "time,x,y,z\n0,0,0,0\n2000,1,0,0\n"}
    described = TypeAdapter(TrajectoryDescription).validate_python(path)
    with pytest.warns(DefinitionWarning, match=r"in ms\? Then call their column `time \[ms\]`"):
        warn_of_units(described, Tabulated.through([0.0, 2000.0], [[0.0], [1.0]]), 3.0)


def test_nanoseconds_of_a_message_are_suspected(file: Path) -> None:
    given = json.dumps(message("shoulder", "elbow", "wrist", at=(0, 2_000_000_000)))
    with pytest.warns(DefinitionWarning, match=r"the text lasts 2e\+09 s.*are its times in ns?"):
        loaded(file, kind="joint_trajectory", text=given)


def test_a_motion_in_another_order_is_not_simulated_by_position(file: Path) -> None:
    scenario = loaded(file, kind="joint_trajectory", text=json.dumps(message("shoulder", "elbow", "wrist")))
    motion = Tabulated.from_joint_trajectory(message("wrist", "shoulder", "elbow"))
    with pytest.raises(DefinitionError, match=r"are `wrist`, `shoulder`, `elbow`, but the robot's order is .*joints="):
        scenario.replace(trajectory=motion).simulate(progress=False)
    again = Tabulated.from_joint_trajectory(
        message("wrist", "shoulder", "elbow"), joints=scenario.plant.robot.joint_names
    )
    np.testing.assert_array_equal(again.coefficients, scenario.trajectory.coefficients)


def _rows(given: dict[str, Any]) -> list[tuple[float, list[float]]]:
    return [(point["time_from_start"], point["positions"]) for point in given["points"]]


def _yaml(given: dict[str, Any]) -> str:
    lines = ["joint_names:", *(f"- {name}" for name in given["joint_names"]), "points:"]
    for time, positions in _rows(given):
        lines += ["- positions:", *(f"  - {q}" for q in positions), "  velocities: []", "  time_from_start:"]
        lines += [f"    sec: {int(time)}", "    nanosec: 0"]
    return "\n".join(lines) + "\n"
