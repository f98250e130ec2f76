"""Motions from CSV files and ROS messages: what is read is what was written, and what is wrong is named."""

import json

import numpy as np
import pytest

from slidax._errors import DefinitionError
from slidax.trajectories import Tabulated

CSV = """time,shoulder,elbow
0.5,0.0,1.0
1.3,0.8,0.2
2.0,0.5,-0.4
3.1,-0.3,0.6
"""
TIMES = np.array([0.5, 1.3, 2.0, 3.1])
PLACES = np.array([[0.0, 1.0], [0.8, 0.2], [0.5, -0.4], [-0.3, 0.6]])
SPEEDS = np.array([[0.0, 0.0], [0.4, -1.0], [-0.6, 0.1], [0.0, 0.0]])
CURVES = np.array([[0.5, 0.0], [-1.0, 0.3], [0.0, 2.0], [0.0, -1.0]])


def same(ours, theirs):
    np.testing.assert_allclose(ours.times, theirs.times, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(ours.coefficients, theirs.coefficients, rtol=1e-13, atol=1e-13)


def message(columns=1, duration=lambda t: float(t)):
    rows = {"positions": PLACES, "velocities": SPEEDS, "accelerations": CURVES}
    kept = dict(list(rows.items())[:columns])
    points = [
        {name: values[row].tolist() for name, values in kept.items()} | {"time_from_start": duration(TIMES[row])}
        for row in range(4)
    ]
    return {"header": {"stamp": 0}, "joint_names": ["shoulder", "elbow"], "points": points}


def test_a_csv_text_and_a_csv_file_are_the_same_motion(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text(CSV, encoding="utf-8")
    expected = Tabulated.through(TIMES, PLACES)
    for source in (CSV, file, str(file)):
        same(Tabulated.from_csv(source), expected)


def test_comments_blank_lines_spaces_units_and_what_spreadsheets_write_are_read():
    text = "\ufeff# recorded by hand\r\n\r\n" + CSV.replace("time,", "time [s], ").replace("elbow", "elbow [rad]")
    same(Tabulated.from_csv(text.replace("\n", "\r\n")), Tabulated.through(TIMES, PLACES))


def test_a_csv_file_may_have_velocities_and_accelerations_in_any_order_of_columns():
    titles = "elbow.acceleration,time,elbow,shoulder.velocity,shoulder,elbow.velocity [rad/s],shoulder.acceleration"
    columns = [CURVES[:, 1], TIMES, PLACES[:, 1], SPEEDS[:, 0], PLACES[:, 0], SPEEDS[:, 1], CURVES[:, 0]]
    lines = [titles, *(",".join(repr(float(x)) for x in row) for row in np.transpose(columns))]
    motion = Tabulated.from_csv("\n".join(lines), joints=["shoulder", "elbow"])
    same(motion, Tabulated.through(TIMES, PLACES, SPEEDS, CURVES))


def test_joints_come_in_the_order_of_the_robot():
    same(Tabulated.from_csv(CSV, joints=["elbow", "shoulder"]), Tabulated.through(TIMES, PLACES[:, ::-1]))
    given = message(2)
    same(
        Tabulated.from_joint_trajectory(given, joints=["elbow", "shoulder"]),
        Tabulated.through(TIMES, PLACES[:, ::-1], SPEEDS[:, ::-1]),
    )


def test_limits_go_with_the_joints_of_the_robot():
    with pytest.raises(DefinitionError, match=r"the text: joint `shoulder` would go to -0.3.*below its limit of -0.2"):
        Tabulated.from_csv(CSV, joints=["elbow", "shoulder"], lower=[-1.0, -0.2])


def test_a_table_can_be_moved_to_another_start():
    moved = Tabulated.from_csv(CSV.replace("0.5,0.0", "-7.5,0.0"), start=0.0)
    assert (float(moved.times[0]), float(moved.until)) == (0.0, 3.1 + 7.5)


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize(
    "duration",
    [
        float,
        lambda t: {"sec": int(t), "nanosec": round((t - int(t)) * 1e9)},
        lambda t: {"secs": int(t), "nsecs": round((t - int(t)) * 1e9)},
    ],
    ids=["seconds", "ROS 2", "ROS 1"],
)
def test_a_ros_message_is_read_from_a_mapping_a_text_and_a_file(tmp_path, columns, duration):
    given = message(columns, duration)
    file = tmp_path / "motion.json"
    file.write_text(json.dumps(given), encoding="utf-8")
    expected = Tabulated.through(TIMES, *(PLACES, SPEEDS, CURVES)[:columns])
    for source in (given, json.dumps(given), file, str(file)):
        same(Tabulated.from_joint_trajectory(source), expected)


def test_empty_lists_in_a_message_mean_that_there_is_nothing():
    given = message(1)
    for point in given["points"]:
        point |= {"velocities": [], "accelerations": [], "effort": []}
    same(Tabulated.from_joint_trajectory(given), Tabulated.through(TIMES, PLACES))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\n", "the text is empty: the first line must name the columns"),
        ("0,1,2\n1,2,3\n", "line 1: the first line must name the columns, such as `time,shoulder,elbow`"),
        ("time;a;b\n0;1;2\n", "line 1: columns must be separated by commas"),
        ("t,a\n0,1\n1,2\n", "line 1: there must be a column `time` .*is it `t`"),
        ("time\n0\n1\n", "there must be a column per joint besides `time`"),
        ("time [ms],a\n0,1\n1,2\n", r"column `time \[ms\]`: must be in s; convert the column and its title"),
        ("time,a [deg]\n0,1\n1,2\n", r"column `a \[deg\]`: must be in rad or m"),
        ("time,a,a.velocity [deg/s]\n0,1,0\n1,2,0\n", "must be in rad/s or m/s"),
        ("time,a,a\n0,1,2\n1,2,3\n", "line 1: the column `a` is there twice"),
        ("time,a,\n0,1,2\n1,2,3\n", "column 3 has no name"),
        (
            "time,a,b,a.velocity\n0,1,2,0\n1,2,3,0\n",
            "the column `b.velocity` is missing: give velocities for all joints",
        ),
        ("time,a,c.velocity\n0,1,0\n1,2,0\n", "there is `c.velocity`, but no column `c` with positions"),
        ("time,a\n0,1\n\n1,2,3\n", "line 4: 3 entries, but there are 2 columns"),
        ("time,a\n0,1\n1,\n", "line 3, column `a`: there is no number"),
        ("time,a\n0,1\n1,x\n", "line 3, column `a`: `x` is not a number"),
        ("time,a\n0,1\n1,nan\n", "line 3, column `a`: `nan` is not a finite number"),
        ("time,a\n0,1\n", "the text has 1 rows: a motion needs two or more"),
        ("time,a\n0,1\n2,1\n1,1\n", "the text, line 4: time 1 s comes after 2 s: the times must increase"),
        ("# a note\ntime,a\n0,1\n0,2\n", "the text, line 4: .* two rows at one time would be a jump"),
        ("time,a,a.velocity\n0,1,0\n1,2,0.4\n", "line 3: joint `a` has a velocity of 0.4 rad/s .* at its end, t = 1 s"),
    ],
)
def test_what_is_wrong_in_a_csv_file_is_named_with_line_and_column(text, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_csv(text)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (["shoulder", "elbow", "wrist"], "the text lacks the joint `wrist`; there are: `shoulder`, `elbow`"),
        (["shoulder", "elbov"], "has the joint `elbow`, which the robot does not have; did you mean `elbov`?"),
        (["shoulder"], "has the joint `elbow`, which the robot does not have"),
        (["shoulder", "elbow", "elbow"], "`joints` has the joint `elbow` more than once"),
    ],
)
def test_names_that_do_not_fit_the_robot_are_refused_with_the_nearest(joints, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_csv(CSV, joints=joints)


def changed(**changes):
    given = message(2)
    for path, value in changes.items():
        row, field = path.split("__") if "__" in path else (None, path)
        place = given if row is None else given["points"][int(row[1:])]
        if value is None:
            del place[field]
        else:
            place[field] = value
    return given


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("{", "the text is not valid JSON: line 1"),
        ("[1]", "must be a JSON object with `joint_names` and `points`"),
        ({"trajectory": {}}, "has no `joint_names`: .*; it has `trajectory`: give that"),
        (changed(points=None), "has no `points`: it must be a trajectory_msgs/JointTrajectory"),
        (changed(joint_names=["shoulder", "shoulder"]), "has the joint `shoulder` more than once"),
        (changed(joint_names="shoulder"), "`joint_names` must be a list of names"),
        (changed(points=[1, 2]), r"points\[0\]: must be a mapping"),
        (
            changed(r1__positions=[0.0]),
            r"points\[1\]: `positions` must have one number for each of 2 joints; got 1 of them",
        ),
        (changed(r1__positions=None), r"points\[1\]: `positions` must have .*; got none"),
        (changed(r1__positions=[0.0, "x"]), r"points\[1\]: `positions` of `elbow` must be a number; got 'x'"),
        (
            changed(r2__velocities=[]),
            r"points\[0\] has `velocities`, but points\[2\] has not: give them for all, or for none",
        ),
        (changed(r1__time_from_start=None), r"points\[1\]: `time_from_start` must be"),
        (changed(r1__time_from_start={"sec": 1, "nsecs": 2}), r"points\[1\]: `time_from_start` must be"),
        (changed(r1__time_from_start=0.5), r"points\[1\]: time 0.5 s comes after 0.5 s: two rows at one time"),
        (changed(r3__velocities=[0.0, 0.1]), r"points\[3\]: joint `elbow` has a velocity of 0.1 rad/s .* at its end"),
        (
            json.dumps(changed(r1__positions=[0.0, float("nan")])),
            r"points\[1\]: the position of joint `elbow` must be a finite",
        ),
    ],
)
def test_what_is_wrong_in_a_ros_message_is_named_with_the_point(given, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_joint_trajectory(given)


def test_a_file_that_is_not_there_or_no_text_is_named(tmp_path):
    with pytest.raises(DefinitionError, match=r"cannot read the file `.*gone.csv`: No such file"):
        Tabulated.from_csv(tmp_path / "gone.csv")
    picture = tmp_path / "picture.json"
    picture.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(DefinitionError, match="it is not UTF-8 text"):
        Tabulated.from_joint_trajectory(picture)
