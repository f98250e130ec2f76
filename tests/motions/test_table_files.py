"""Motions from CSV files and ROS messages: values are read exactly, and errors name their place."""

import json

import numpy as np
import pytest

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.motions import Tabulated

from .members import CURVES, PLACES, SPEEDS, TIMES

CSV = """time,shoulder,elbow
0.5,0.0,1.0
1.3,0.8,0.2
2.0,0.5,-0.4
3.1,-0.3,0.6
"""


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


def test_comments_blank_lines_spaces_units_and_spreadsheet_encodings_are_accepted():
    text = "\ufeff# recorded by hand\r\n\r\n" + CSV.replace("time,", "time [s], ").replace("elbow", "elbow [rad]")
    same(Tabulated.from_csv(text.replace("\n", "\r\n")), Tabulated.through(TIMES, PLACES))


def test_a_csv_file_may_have_velocities_and_accelerations_in_any_order_of_columns():
    titles = "elbow.acceleration,time,elbow,shoulder.velocity,shoulder,elbow.velocity [rad/s],shoulder.acceleration"
    columns = [CURVES[:, 1], TIMES, PLACES[:, 1], SPEEDS[:, 0], PLACES[:, 0], SPEEDS[:, 1], CURVES[:, 0]]
    lines = [titles, *(",".join(repr(float(x)) for x in row) for row in np.transpose(columns))]
    motion = Tabulated.from_csv("\n".join(lines), joints=["shoulder", "elbow"])
    same(motion, Tabulated.through(TIMES, PLACES, SPEEDS, CURVES))


def test_joint_columns_are_reordered_to_the_order_of_the_robot():
    same(Tabulated.from_csv(CSV, joints=["elbow", "shoulder"]), Tabulated.through(TIMES, PLACES[:, ::-1]))
    data = message(2)
    same(
        Tabulated.from_joint_trajectory(data, joints=["elbow", "shoulder"]),
        Tabulated.through(TIMES, PLACES[:, ::-1], SPEEDS[:, ::-1]),
    )


def test_joints_that_the_robot_does_not_have_are_left_out_with_a_warning():
    with_finger = "time,finger,shoulder,shoulder.velocity,thumb\n0,.5,0,0,1\n1,.6,1,0,2\n"
    with pytest.warns(DefinitionWarning, match=r"the text: `finger`, `thumb` are not joints of the robot and are left"):
        motion = Tabulated.from_csv(with_finger, joints=["shoulder"])
    same(motion, Tabulated.through([0.0, 1.0], [[0.0], [1.0]], [[0.0], [0.0]]))
    with pytest.warns(DefinitionWarning, match="`elbow` is not a joint of the robot and is left out"):
        motion = Tabulated.from_joint_trajectory(message(3), joints=["shoulder"])
    same(motion, Tabulated.through(TIMES, PLACES[:, :1], SPEEDS[:, :1], CURVES[:, :1]))


@pytest.mark.parametrize(
    ("titles", "joints"),
    [
        ('"Elbow ", SHOULDER', ["shoulder", "elbow"]),
        ("joint_2,Joint1", ["joint 1", "joint 2"]),
        ("e\u0301paule,arm/base-yaw", ["arm/base-yaw", "\u00e9paule"]),
        ("b_1,b1", ["b1", "b_1"]),
    ],
)
def test_names_match_without_regard_to_case_spaces_and_quotation_marks(titles, joints):
    text = f"time,{titles}\n0,1,2\n1,3,5\n"
    same(Tabulated.from_csv(text, joints=joints), Tabulated.through([0.0, 1.0], [[2.0, 1.0], [5.0, 3.0]]))


def test_column_names_that_differ_only_in_punctuation_match_exactly_or_not_at_all():
    with pytest.raises(DefinitionError, match="lacks the joint `B-1`"):
        Tabulated.from_csv("time,b_1,b.1,c\n0,1,2,3\n1,2,3,4\n", joints=["c", "B-1"])


def test_separate_numbers_in_a_joint_name_are_not_joined():
    """The first joint of the first finger is not joint 11."""
    with pytest.raises(DefinitionError, match="lacks the joint `joint_11`"):
        Tabulated.from_csv("time,joint_1_1\n0,1\n1,2\n", joints=["joint_11"])
    same(
        Tabulated.from_csv("time,Joint-1-1\n0,1\n1,2\n", joints=["joint_1_1"]),
        Tabulated.through([0.0, 1.0], [[1.0], [2.0]]),
    )


def test_unnamed_joints_take_the_columns_in_order_with_a_warning():
    with pytest.warns(DefinitionWarning, match="columns `shoulder`, `elbow` move `joint 1`, `joint 2` in this order"):
        same(Tabulated.from_csv(CSV, joints=["joint 1", "joint 2"]), Tabulated.through(TIMES, PLACES))


def test_units_in_column_titles_are_applied():
    titles = "time [ms],shoulder (deg),elbow [\u00b0],shoulder.velocity [deg/s],elbow.velocity [rpm]"
    columns = [
        1e3 * TIMES,
        np.rad2deg(PLACES[:, 0]),
        np.rad2deg(PLACES[:, 1]),
        np.rad2deg(SPEEDS[:, 0]),
        30 / np.pi * SPEEDS[:, 1],
    ]
    lines = [titles, *(",".join(repr(float(x)) for x in row) for row in np.transpose(columns))]
    motion, expected = Tabulated.from_csv("\n".join(lines)), Tabulated.through(TIMES, PLACES, SPEEDS)
    np.testing.assert_allclose(motion.times, expected.times, rtol=1e-15)
    np.testing.assert_allclose(motion.coefficients, expected.coefficients, rtol=1e-12, atol=1e-12)


def test_a_length_unit_for_a_revolute_joint_is_refused():
    text = "time,a [mm],b [deg]\n0,1,2\n1,2,3\n"
    Tabulated.from_csv(text, joints=["a", "b"], units=["m", "rad"])
    with pytest.raises(DefinitionError, match="the column `a` is in m, but `a` is revolute"):
        Tabulated.from_csv(text, joints=["a", "b"], units=["rad", "rad"])


@pytest.mark.parametrize(
    ("titles", "words"),
    [
        ("a [deg],a.velocity [mm/s]", "the column `a.velocity` is in m, but `a` in rad"),
        ("a,a.velocity [mm/s]", "the column `a.velocity` is in m, but `a` is revolute"),
        ("a [deg],a.velocity", r"`a.velocity` has no unit: write its unit in brackets, such as `a.velocity \[rad/s\]`"),
        ("a [deg],a.velocity [deg/s],a.acceleration", r"such as `a.acceleration \[rad/s2\]`"),
    ],
)
def test_contradicting_or_missing_units_of_velocities_and_accelerations_are_refused(titles, words):
    units = ["rad"] if titles.startswith("a,") else []
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_csv(f"time,{titles}\n", joints=["a"], units=units)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_in_another_unit_cause_a_warning_and_are_read_with_time_unit(unit, factor):
    t = np.linspace(0.0, 2.0, 101)
    q = 0.4 * (1 - np.cos(np.pi * t / 2))
    text = "time,a\n" + "\n".join(f"{factor * x:.9g},{y:.9g}" for x, y in zip(t, q, strict=True))
    with pytest.warns(DefinitionWarning, match=f"are the times in {unit}\\? Then set `time_unit` to {unit}"):
        Tabulated.from_csv(text)
    np.testing.assert_allclose(Tabulated.from_csv(text, time_unit=unit).times, t, rtol=1e-8)
    assert float(Tabulated.from_csv(text, time_unit="s").until) == pytest.approx(2 * factor)
    points = [{"positions": [y], "time_from_start": factor * x} for x, y in zip(t, q, strict=True)]
    data = {"joint_names": ["a"], "points": points}
    np.testing.assert_allclose(Tabulated.from_joint_trajectory(data, time_unit=unit).times, t, rtol=1e-12)


def test_contradictory_or_unknown_time_unit_is_an_error():
    with pytest.raises(DefinitionError, match="has another unit than `time_unit`, ms"):
        Tabulated.from_csv("time [s],a\n0,1\n1,2\n", time_unit="ms")
    with pytest.raises(DefinitionError, match="`time_unit` must be one of s, ms, us, ns; got 'min'"):
        Tabulated.from_csv(CSV, time_unit="min")
    with pytest.raises(DefinitionError, match=r"points\[0\]: `time_from_start` already has a unit"):
        Tabulated.from_joint_trajectory(message(1, lambda t: {"sec": int(10 * t), "nanosec": 0}), time_unit="ms")


@pytest.mark.parametrize(("separator", "decimal"), [(";", "."), (";", ","), ("\t", "."), ("\t", ","), ("  ", ".")])
def test_separators_and_decimal_commas_are_recognised(separator, decimal):
    text = CSV.replace(",", separator).replace(".", decimal)
    same(Tabulated.from_csv(text), Tabulated.from_csv(CSV))


def test_lines_without_entries_are_ignored():
    same(Tabulated.from_csv(CSV + ",,\n ,,\n"), Tabulated.from_csv(CSV))


def test_limits_follow_the_robots_joint_order():
    with pytest.raises(DefinitionError, match=r"the text: joint `shoulder` would go to -0.3.*below its limit of -0.2"):
        Tabulated.from_csv(CSV, joints=["elbow", "shoulder"], lower=[-1.0, -0.2])


def test_a_table_can_be_shifted_to_another_start_time():
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
    data = message(columns, duration)
    file = tmp_path / "motion.json"
    file.write_text(json.dumps(data), encoding="utf-8")
    expected = Tabulated.through(TIMES, *(PLACES, SPEEDS, CURVES)[:columns])
    for source in (data, json.dumps(data), file, str(file)):
        same(Tabulated.from_joint_trajectory(source), expected)


def test_empty_lists_in_a_message_count_as_missing():
    data = message(1)
    for point in data["points"]:
        point |= {"velocities": [], "accelerations": [], "effort": []}
    same(Tabulated.from_joint_trajectory(data), Tabulated.through(TIMES, PLACES))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\n", "the text is empty: the first line must name the columns"),
        ("0,1,2\n1,2,3\n", "line 1: numbers, but the first line must name the columns, such as `time,shoulder,elbow`"),
        ("t,a\n0,1\n1,2\n", "line 1: there must be a column `time` .*is `t` the time"),
        ("time\n0\n1\n", "there must be a column with the positions of each joint"),
        ("time [min],a\n0,1\n1,2\n", r"column `time \[min\]`: the unit must be one of s, sec, ms"),
        ("time,a [Nm]\n0,1\n1,2\n", r"column `a \[Nm\]`: the unit must be one of rad, m, deg"),
        ("time,a,a.velocity [rad]\n0,1,0\n1,2,0\n", "the unit must be one of rad/s, m/s"),
        ('time,"a\n0,0\n1,1\n', "the text, line 1: a quotation mark is not closed"),
        ("TIME,Time [s],a\n0,0,0\n1,1,1\n", r"line 1: the column `Time \[s\]` occurs twice"),
        ("time,a,a\n0,1,2\n1,2,3\n", "line 1: the column `a` occurs twice"),
        ("time,a,\n0,1,2\n1,2,3\n", "line 2: 3 entries, but line 1 names 2 columns"),
        (
            "time,a,b,a.velocity\n0,1,2,0\n1,2,3,0\n",
            "the column `b.velocity` is missing: give velocities for all joints",
        ),
        ("time,a,c.velocity\n0,1,0\n1,2,0\n", "there is `c.velocity`, but no column `c` with positions"),
        (
            "time,a\n0,1\n\n1,2,3\n",
            "line 4: 3 entries, but line 1 names 2 columns; if the decimal sign is a comma",
        ),
        ("time,a\n0,1\n1,\n", "line 3, column `a`: there is no number"),
        ("time,a\n0,1\n1,x\n", "line 3, column `a`: `x` is not a number"),
        ("time,a\n0,1\n1,1_5\n", "line 3, column `a`: `1_5` is not a number"),
        ("time;a\n0;0,5\n1;1.500\n", "line 2, column `a`: `0,5` is not a number"),
        ("time,a\n0,1\n1,nan\n", "line 3, column `a`: `nan` is not a finite number"),
        ("time,a\n0,1\n", "the text has 1 row: a motion needs two or more"),
        ("time,a\n0,1\n2,1\n1,1\n", "the text, line 4: time 1 s comes after 2 s: the times must increase"),
        ("# a note\ntime,a\n0,1\n0,2\n", "the text, line 4: .* two rows at one time would be a jump"),
        ("time,a,a.velocity\n0,1,0\n1,2,0.4\n", "line 3: joint `a` has a velocity of 0.4 rad/s .* at its end, t = 1 s"),
    ],
)
def test_csv_errors_name_line_and_column(text, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_csv(text)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (["shoulder", "elbow", "wrist"], r"the text lacks the joint `wrist`; there are: `shoulder`, `elbow`\. If the"),
        (["shoulder", "elbov"], r"the text lacks the joint `elbov`; did you mean `elbow`\?"),
        (["hip", "knee"], r"lacks the joints `hip`, `knee`; .* list the file's names, in this order, as"),
        (["joint 1", "joint 2", "joint 3"], "moves 2 joints, `shoulder`, `elbow`, but the robot has 3"),
        (["shoulder", "elbow", "elbow"], "`joints` has the joint `elbow` more than once"),
    ],
)
def test_joint_names_that_do_not_match_the_columns_are_refused(joints, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_csv(CSV, joints=joints)


def changed(**changes):
    data = message(2)
    for path, value in changes.items():
        row, field = path.split("__") if "__" in path else (None, path)
        place = data if row is None else data["points"][int(row[1:])]
        if value is None:
            del place[field]
        else:
            place[field] = value
    return data


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("{", "the text is not valid JSON: line 1"),
        ("[1]", "must be a JSON object with `joint_names` and `points`"),
        ({"trajectory": {}}, "has no `joint_names`: .*; it has `trajectory`: pass that field alone"),
        (changed(points=None), "has no `points`: it must be a trajectory_msgs/JointTrajectory"),
        (changed(joint_names=["shoulder", "shoulder"]), "has the joint `shoulder` more than once"),
        (changed(joint_names="shoulder"), "`joint_names` must be a list of names"),
        (changed(points=[1, 2]), r"points\[0\]: must be a mapping"),
        (
            changed(r1__positions=[0.0]),
            r"points\[1\]: `positions` must have one number for each of the 2 joints; got 1 of them",
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
def test_ros_message_errors_name_the_point(data, words):
    with pytest.raises(DefinitionError, match=words):
        Tabulated.from_joint_trajectory(data)


def test_missing_or_binary_file_is_an_error_that_names_it(tmp_path):
    with pytest.raises(DefinitionError, match=r"cannot read the file `.*gone.csv`: No such file"):
        Tabulated.from_csv(tmp_path / "gone.csv")
    picture = tmp_path / "picture.json"
    picture.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(DefinitionError, match="it is not UTF-8 text"):
        Tabulated.from_joint_trajectory(picture)
