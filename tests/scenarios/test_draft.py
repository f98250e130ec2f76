"""`slidax new` for any arm: the file runs as it is, within every limit, and lists its assumptions."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml

from slidax import analysis, scenarios
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.scenarios import draft
from slidax.simulation import Run
from slidax.simulation.states import states_of

JOINT = """
<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{link}"/><origin xyz="{xyz}"/>
<axis xyz="{axis}"/>{limit}{more}</joint>
<link name="{link}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(
    name: str,
    parent: str,
    link: str,
    *,
    kind: str = "revolute",
    axis: str = "0 1 0",
    limit: tuple[float, float, float, float] | None = (-2.5, 2.5, 2.0, 40.0),
    mass: float = 1.0,
    more: str = "",
    xyz: str = "0 0 0.25",
) -> str:
    limits = "" if limit is None else '<limit lower="{}" upper="{}" velocity="{}" effort="{}"/>'.format(*limit)
    return JOINT.format(
        name=name, kind=kind, parent=parent, link=link, axis=axis, limit=limits, mass=mass, more=more, xyz=xyz
    )


EFFORTS = (20.0, 40.0, 15.0, 5.0)


def arm(efforts: tuple[float, ...] = EFFORTS, more: str = "") -> str:
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0")
    names = ["base", "shoulder", "upper", "fore", "wrist"]
    parts = [
        joint(f"j{i + 1}", names[i], names[i + 1], axis=axes[i], limit=(-2.5, 2.5, 2.0 + 0.1 * i, efforts[i]))
        for i in range(4)
    ]
    return f'<robot name="four"><link name="base"/>{"".join(parts)}{more}</robot>'


HAND = (
    joint("finger_left", "wrist", "left", kind="prismatic", limit=(0.0, 0.04, 0.1, 10.0), mass=0.05)
    + joint(
        "finger_right",
        "wrist",
        "right",
        kind="prismatic",
        limit=(0.0, 0.04, 0.1, 10.0),
        mass=0.05,
        more='<mimic joint="finger_left"/>',
    )
    + '<joint name="f" type="fixed"><parent link="wrist"/><child link="tool0"/></joint><link name="tool0"/>'
)


pytest.importorskip("mujoco")


def new(folder: Path, text: str, rate: float = 1000.0, changes: dict | None = None, **more: str):
    (folder / "arm.urdf").write_text(text)
    drafted = draft(folder / "arm.urdf", rate, folder=folder, **more)
    (folder / "arm.yaml").write_text(drafted.text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DefinitionWarning)
        return drafted, scenarios.load(folder / "arm.yaml", changes)


def assert_inside(run: Run) -> None:
    """Check that the run reached its end, since one that became infinite has no sample outside either."""
    assert run.outcome.ok, run.outcome.message
    assert analysis.envelope_violations(run) == 0


@pytest.mark.parametrize(("rate", "radius"), [(1000.0, 0.005), (250.0, 0.02)])
def test_a_draft_runs_inside_its_envelope_also_with_an_unknown_payload(tmp_path, rate, radius):
    changes = {"robot.plant": {"mass_factor": 1.1, "load": {"mass": 0.5}}, "simulation.t1": 4.0}
    _, scenario = new(tmp_path, arm(), rate, changes)
    run = scenario.simulate(log_every=1)
    assert_inside(run)
    assert np.abs(run.log.e[np.asarray(run.log.t) > 2.0]).max() < radius


@pytest.mark.full
@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_the_draft_motion_of_a_built_in_arm_stays_within_its_limits(tmp_path, name):
    (tmp_path / "a.yaml").write_text(draft(name, 500.0).text)
    scenario = scenarios.load(tmp_path / "a.yaml")
    nominal, t = scenario.controller.nominal, np.linspace(0.0, 8.0, 100)
    block = scenario.description.trajectory
    angle = np.array(block.frequency) * t[:, None]
    q = np.array(block.offset) + np.array(block.amplitude) * np.sin(angle)
    torque = states_of(nominal, q).bias
    assert (np.abs(torque) < 0.8 * np.asarray(nominal.limits.torque)).all()
    assert (np.array(block.amplitude) * np.array(block.frequency) <= 0.5 * np.asarray(nominal.limits.velocity)).all()
    assert (q > np.asarray(nominal.limits.lower)).all() and (q < np.asarray(nominal.limits.upper)).all()


def test_a_draft_uses_plausible_torque_limits_unchanged(tmp_path):
    drafted, scenario = new(tmp_path, arm())
    assert np.asarray(scenario.controller.limits.torque).tolist() == list(EFFORTS) and drafted.notes == ()
    assert scenario.robot == "urdf" and "four, 4 joints" in repr(scenario)


@pytest.mark.parametrize(
    ("efforts", "message"),
    [
        # Joints 1 and 2 need more than the limit, which they keep.
        ((20.0,) * 4, "20 N m for every joint"),
        ((300.0,) * 4, "300 N m for every joint"),
        ((2000.0,) * 4, "2000 N m for every joint"),
        ((0.0,) * 4, "no effort limit in the file, or 0"),
        ((0.5,) * 4, "0.5 N m for every joint, too small for half of the weight that j2, j3"),
        ((20.0, 40.0, 15.0, 900.0), "j4: 900 N m"),
    ],
)
def test_a_placeholder_torque_limit_is_reported_with_its_replacement(tmp_path, efforts, message):
    drafted, scenario = new(tmp_path, arm(efforts))
    (note,) = [note for note in drafted.notes if message in note]
    assert "is assumed" in note
    torque = np.asarray(scenario.controller.limits.torque)
    assert torque.max() < 100.0
    assumed = [float(number) for number in re.search(r"; ([\d., ]+) N m is assumed", note)[1].split(",")]
    assert assumed == torque[-len(assumed) :].tolist()
    assert "".join(note.split()) in "".join(drafted.text.replace("#", "").split())


def test_equal_and_missing_velocity_limits_are_reported(tmp_path):
    equal = arm().replace('velocity="2.1"', 'velocity="2.0"').replace('velocity="2.2"', 'velocity="2.0"')
    drafted, _ = new(tmp_path, equal.replace('velocity="2.3"', 'velocity="2.0"'))
    assert any("the velocity limit 2 rad/s, which" in note for note in drafted.notes)
    drafted, scenario = new(tmp_path, arm().replace('velocity="2.0"', 'velocity="0"'))
    assert any(note.startswith("j1: no velocity limit in the file") for note in drafted.notes)
    assert scenario.description.trajectory.amplitude[0] * scenario.description.trajectory.frequency[0] < 1.0


def test_a_gripper_is_locked_and_the_tool_frame_is_the_tip(tmp_path):
    drafted, scenario = new(tmp_path, arm(more=HAND))
    assert scenario.controller.nominal.joint_names == ("j1", "j2", "j3", "j4") and "tip: tool0" in drafted.text
    assert any("finger_left, finger_right" in note for note in drafted.notes)


def test_names_with_a_meaning_in_yaml_are_quoted(tmp_path):
    text = arm(more=HAND).replace('name="four"', 'name="four: best # ever"').replace("tool0", "yes: no")
    _, scenario = new(tmp_path, text, tip="yes: no")
    assert scenario.description.title == "four: best # ever at 1000 Hz"
    assert scenario.description.robot.tip == "yes: no"


@pytest.mark.full
def test_continuous_and_prismatic_joints_get_a_motion_of_suitable_size(tmp_path):
    sliding = joint("lift", "base", "column", kind="prismatic", axis="0 0 1", limit=(0.0, 0.4, 0.2, 400.0), mass=2.0)
    turning = (
        arm().replace('type="revolute"', 'type="continuous"', 1).replace('parent link="base"', 'parent link="column"')
    )
    _, scenario = new(tmp_path, turning.replace('<link name="base"/>', f'<link name="base"/>{sliding}'))
    block = scenario.description.trajectory
    assert scenario.controller.nominal.joint_units[0] == "m" and block.amplitude[0] <= 0.1
    assert_inside(scenario.simulate())


def test_a_robot_file_with_two_arms_is_refused_without_a_tip(tmp_path):
    other = arm().split('<link name="base"/>')[1].removesuffix("</robot>")
    for name in ("shoulder", "upper", "fore", "wrist", "j1", "j2", "j3", "j4"):
        other = other.replace(f'"{name}"', f'"other_{name}"')
    both = arm(more=other)
    with pytest.raises(DefinitionError, match=r"several arms; choose one by its tip \(`--tip`\): .*wrist"):
        new(tmp_path, both)
    _, scenario = new(tmp_path, both, tip="other_wrist")
    assert scenario.controller.nominal.joint_names[0] == "other_j1"


@pytest.mark.parametrize(
    ("robot", "rate", "message"),
    [
        ("pandaa", 1000.0, "did you mean `panda`"),
        ("nowhere.urdf", 1000.0, "cannot read"),
        ("panda", 0.0, "20 to 20000 Hz"),
        ("panda", float("nan"), "20 to 20000 Hz"),
    ],
)
def test_a_draft_for_an_unknown_robot_or_an_invalid_rate_is_refused(robot, rate, message):
    with pytest.raises(DefinitionError, match=message):
        draft(robot, rate)


SLIDE = """<robot name="slides"><link name="base"/>{}</robot>"""
SLIDING = """<link name="l{k}"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{k}" type="{kind}"><parent link="{parent}"/><child link="l{k}"/><origin xyz="0 0 0.2"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2" effort="300"/></joint>"""


def test_a_draft_for_a_joint_with_its_tip_on_the_axis_stays_inside_the_envelope(tmp_path):
    text = SLIDE.format(SLIDING.format(k=0, kind="prismatic", parent="base"))
    # A division by zero would be a warning, which is an error in the tests.
    drafted, scenario = new(tmp_path, text, changes={"simulation.t1": 0.5})
    assert np.isfinite(scenario.state0.q).all() and "nan" not in drafted.text
    assert_inside(scenario.simulate())


def test_a_velocity_limit_shared_by_mixed_joints_is_reported_in_rad_s_or_m_s(tmp_path):
    kinds, parents = ("revolute", "prismatic", "revolute"), ("base", "l0", "l1")
    links = (SLIDING.format(k=k, kind=kind, parent=parents[k]) for k, kind in enumerate(kinds))
    (tmp_path / "arm.urdf").write_text(SLIDE.format("".join(links)))
    notes = draft(tmp_path / "arm.urdf", folder=tmp_path).notes
    assert any("the velocity limit 2 rad/s or m/s" in note for note in notes)


FOLLOWS = '<mimic joint="j2" multiplier="-1"/>'


def test_an_arm_with_a_mimic_joint_is_refused_and_the_suggested_tip_works(tmp_path):
    text = arm().replace('<child link="fore"/>', '<child link="fore"/>' + FOLLOWS)
    with pytest.raises(DefinitionError, match=r"joint `j3` of .* follows another joint.*`--tip upper` ends the arm"):
        new(tmp_path, text, tip="wrist")
    _, scenario = new(tmp_path, text, tip="upper")
    assert scenario.controller.nominal.joint_names == ("j1", "j2")


def test_a_file_with_only_mimic_joints_and_their_leaders_is_refused_without_a_tip(tmp_path):
    text = arm().replace('<child link="upper"/>', '<child link="upper"/><mimic joint="j1"/>')
    with pytest.raises(DefinitionError, match=r"no joint is part of an arm: `j1`, `j2` follow or lead.*`--tip LINK`"):
        new(tmp_path, text)


@pytest.mark.full
@pytest.mark.parametrize(("rate", "horizon"), [(1000.0, 0.01875), (500.0, 0.025), (250.0, 0.036)])
def test_a_drafts_horizon_for_a_heavy_payload_keeps_the_arm_inside_its_envelope(tmp_path, rate, horizon):
    drafted = draft("gen3", rate, payload=4.0)
    (tmp_path / "arm.yaml").write_text(drafted.text)
    scenario = scenarios.load(tmp_path / "arm.yaml")
    assert scenario.description.scheme.sampled_data.horizon == horizon
    assert_inside(scenario.simulate())
    assert any("the horizon is" in note for note in drafted.notes) == (horizon != max(0.025, 12 / rate))


def test_a_draft_keeps_the_torque_rate_limits_of_the_arm():
    limits = yaml.safe_load(draft("panda", 1000.0).text)["actuator"]
    expected = np.minimum(20.0 * np.array(limits["torque"]), 1000.0)
    np.testing.assert_allclose(limits["rate"], expected)
    assert max(limits["torque"]) > 50.0
