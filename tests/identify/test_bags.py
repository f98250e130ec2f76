"""Recordings of ROS 2: topics, orders of joints, other publishers, both storages."""

import sqlite3
import struct

import numpy as np
import pytest

from slidax import DefinitionError
from slidax.identify import read_log
from tests.cli.commands import in_process

mcap = pytest.importorskip("mcap.writer")
pytest.importorskip("mcap_ros2")

ARM = ("shoulder", "elbow", "wrist")
K = 240
T = 0.01 * np.arange(K)
Q = np.sin(np.outer(T, [2.0, 3.0, 5.0]))
TAU = 9 * np.cos(np.outer(T, [1.0, 4.0, 2.0]))
START = 1_700_000_000
ZSTD = "zstd"


def joint_state(t, names, q, dq, tau):
    """A message as ROS 2 sends it, packed here by the rules of CDR and not by the code under test."""
    body = bytearray()

    def number(kind, *values):
        body.extend(bytes(-len(body) % struct.calcsize(f"<{kind}")))
        body.extend(struct.pack(f"<{len(values)}{kind}", *values))

    def text(value):
        number("I", len(value) + 1)
        body.extend(value.encode() + b"\0")

    nanoseconds = round(1e9 * t)
    number("i", START + nanoseconds // 10**9)
    number("I", nanoseconds % 10**9)
    text("")
    number("I", len(names))
    for name in names:
        text(name)
    for values in (q, dq, tau):
        number("I", len(values))
        if len(values):
            number("d", *values)
    return b"\0\1\0\0" + bytes(body)


def arm_messages(order=ARM, *, dq=None, tau=TAU, q=Q):
    places = [ARM.index(name) for name in order]
    rates = [()] * K if dq is None else dq[:, places]
    return [joint_state(t, order, q[k, places], rates[k], tau[k, places]) for k, t in enumerate(T)]


def write_mcap(path, topics, kind="sensor_msgs/msg/JointState", *, close=True):
    """Messages by topic, those of each time together."""
    with path.open("wb") as file:
        writer = mcap.Writer(file, chunk_size=4000)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", b"std_msgs/Header header\nstring[] name\n")
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in topics}
        for k in range(max(map(len, topics.values()))):
            for topic, messages in topics.items():
                if k < len(messages):
                    writer.add_message(channels[topic], log_time=k, publish_time=k, data=messages[k])
        if close:
            writer.finish()
    return path


def bag(folder, messages, name="a.mcap"):
    return write_mcap(folder / name, {"/joint_states": messages})


def write_database(path, topics):
    base = sqlite3.connect(path)
    base.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
        "offered_qos_profiles TEXT)"
    )
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    for number, (topic, messages) in enumerate(topics.items(), 1):
        row = (number, topic, "sensor_msgs/msg/JointState", "cdr", "")
        base.execute("INSERT INTO topics VALUES(?, ?, ?, ?, ?)", row)
        rows = [(number, k, message) for k, message in enumerate(messages)]
        base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    base.commit()
    base.close()
    return path


def metadata(folder, names, storage):
    files = "".join(f"\n    - {name}" for name in names)
    text = (
        f"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n  relative_file_paths:{files}\n"
    )
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")


def assert_read(log, *notes):
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.tau, TAU)
    assert len(log.notes) == len(notes)
    for note, words in zip(log.notes, notes, strict=True):
        assert words in note


def test_joint_states_of_a_bag_are_assigned_by_joint_names(tmp_path):
    log = read_log(bag(tmp_path, arm_messages(sorted(ARM), dq=TAU)), ARM)
    assert_read(log)
    np.testing.assert_array_equal(log.dq, TAU)


GRIPPER = {"/joint_states": [joint_state(t, ["finger1"], [0.0], (), [0.0]) for t in T]}


@pytest.mark.parametrize(
    ("topic", "others", "case"),
    [("/robot1/joint_states", {}, str), ("/arm/joint_states", GRIPPER, str), ("/arm/joint_states", GRIPPER, str.upper)],
    ids=["only topic", "among others", "in another case"],
)
def test_the_topic_with_the_arms_joints_is_read_automatically(tmp_path, topic, others, case):
    arm = [joint_state(t, [case(name) for name in ARM], Q[k], (), TAU[k]) for k, t in enumerate(T)]
    path = write_mcap(tmp_path / "a.mcap", {**others, topic: arm})
    assert_read(read_log(path, ARM), f"reading topic `{topic}`")


def test_several_topics_with_the_arms_joints_are_refused_unless_a_topic_is_chosen(tmp_path):
    topics = {"/left/joint_states": arm_messages(q=Q + 1), "/right/joint_states": arm_messages()}
    path = write_mcap(tmp_path / "a.mcap", topics)
    with pytest.raises(DefinitionError, match=r"2 topics, `/left/joint_states`, `/right/joint_states`.*--topic"):
        read_log(path, ARM)
    assert_read(read_log(path, ARM, topic="/right/joint_states"))


def test_a_missing_topic_is_refused_with_the_existing_topics(tmp_path):
    path = bag(tmp_path, arm_messages())
    with pytest.raises(DefinitionError, match="did you mean `/joint_states`"):
        read_log(path, ARM, topic="/joint_state")
    path = write_mcap(tmp_path / "b.mcap", {"/camera": [b"\0\1\0\0"]}, "sensor_msgs/msg/Image")
    with pytest.raises(DefinitionError, match="no ROS 2 messages with joint states; its topics are `/camera`"):
        read_log(path, ARM)


def test_messages_of_another_publisher_are_left_out(tmp_path):
    """An arm and a gripper publish on one topic in turn."""
    mixed = []
    for k, message in enumerate(arm_messages()):
        mixed += [message] + ([joint_state(T[k] + 0.001, ["finger1"], [0.0], (), [0.0])] if k % 4 == 0 else [])
    assert_read(read_log(bag(tmp_path, mixed), ARM), f"60 of {K + 60} messages come from another publisher")


def test_a_bag_in_which_all_torques_are_zero_is_refused(tmp_path):
    path = write_mcap(tmp_path / "log.mcap", {"/joint_states": arm_messages(tau=0.0 * TAU)})
    result = in_process("identify", str(path), "--robot", "tests/identify/three_link.urdf")
    assert result.exit_code == 2
    lines = result.output.strip().splitlines()
    assert len(lines) == 1 and "the torques of `log.mcap` are all 0" in lines[0]


def test_joints_of_a_gripper_in_the_same_message_are_left_out_and_named(tmp_path):
    messages = [
        joint_state(t, ["finger1", *ARM, "finger2"], [1.0, *Q[k], 2.0], (), [3.0, *TAU[k], 4.0])
        for k, t in enumerate(T)
    ]
    assert_read(read_log(bag(tmp_path, messages), ARM), "no joint `finger1`, `finger2`: left out")


def test_joint_names_match_regardless_of_case_and_underscores(tmp_path):
    names = ("Wrist", "SHOULDER", "el_bow")
    messages = [joint_state(t, names, Q[k, [2, 0, 1]], (), TAU[k, [2, 0, 1]]) for k, t in enumerate(T)]
    assert_read(read_log(bag(tmp_path, messages), ARM))


def test_joints_missing_in_a_bag_are_named_in_the_error(tmp_path):
    messages = [joint_state(t, ARM[:1], Q[k, :1], (), TAU[k, :1]) for k, t in enumerate(T)]
    path = bag(tmp_path, messages)
    with pytest.raises(DefinitionError, match="there is no joint `elbow`, `wrist`"):
        read_log(path, ARM)


@pytest.mark.parametrize(
    ("dq", "drop", "note"),
    [(np.zeros((K, 3)), [], "all velocities are 0 while the arm moves"), (TAU, ["dq"], "`dq` is left out")],
)
def test_velocities_are_left_out_if_they_are_zero_or_dropped(tmp_path, dq, drop, note):
    log = read_log(bag(tmp_path, arm_messages(dq=dq)), ARM, drop=drop)
    assert log.dq is None
    assert_read(log, note)


def test_a_truncated_bag_is_read_with_a_note(tmp_path):
    body = bag(tmp_path, arm_messages()).read_bytes()
    (tmp_path / "b.mcap").write_bytes(body[: int(0.9 * len(body))])
    log = read_log(tmp_path / "b.mcap", ARM)
    assert 200 <= len(log.t) < K and "is incomplete or damaged" in log.notes[0]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("form", ["listed", "without metadata", "metadata damaged", "packed"])
def test_the_files_of_a_ros2_bag_folder_are_read_in_their_recorded_order(tmp_path, storage, form):
    """Two files, whose names are in the wrong order alphabetically."""
    folder = tmp_path / "bag"
    folder.mkdir()
    ending = ".mcap" if storage == "mcap" else ".db3"
    write = write_mcap if storage == "mcap" else write_database
    if storage == "sqlite3":
        pytest.importorskip("rosbags")
    names = [f"bag_{number}{ending}" for number in (9, 10)]
    for name, part in zip(names, (slice(0, 130), slice(130, None)), strict=True):
        write(folder / name, {"/joint_states": arm_messages(sorted(ARM))[part]})
    if form == "packed":
        zstandard = pytest.importorskip("zstandard")
        for name in names:
            (folder / f"{name}.{ZSTD}").write_bytes(zstandard.compress((folder / name).read_bytes()))
            (folder / name).unlink()
        names = [f"{name}.{ZSTD}" for name in names]
    if form in ("listed", "packed"):
        metadata(folder, names, storage)
    if form == "metadata damaged":
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: [", encoding="utf-8")
    assert_read(read_log(folder, ARM), *([] if form in ("listed", "packed") else ["no readable `metadata.yaml`"]))


def test_individually_compressed_messages_are_read(tmp_path):
    pytest.importorskip("rosbags")
    zstandard = pytest.importorskip("zstandard")
    messages = [zstandard.compress(message) for message in arm_messages()]
    assert_read(read_log(write_database(tmp_path / "a.db3", {"/joint_states": messages}), ARM))


def test_folder_that_is_no_bag_or_lacks_a_listed_file_is_refused(tmp_path):
    # A folder with the ending of a log is not one of the bag's files.
    (tmp_path / "old.mcap").mkdir()
    with pytest.raises(DefinitionError, match=r"is not a ros2 bag folder"):
        read_log(tmp_path, ARM)
    metadata(tmp_path, ["gone.mcap"], "mcap")
    with pytest.raises(DefinitionError, match=r"lacks the file `gone\.mcap`"):
        read_log(tmp_path, ARM)


def test_a_bag_folder_leads_to_no_file_outside(tmp_path):
    outside, folder = bag(tmp_path, arm_messages(), "outside.mcap"), tmp_path / "bag"
    folder.mkdir()
    for listed in ("../outside.mcap", str(outside)):
        metadata(folder, [listed], "mcap")
        with pytest.raises(DefinitionError, match=r"lacks the file `outside\.mcap`"):
            read_log(folder, ARM)


def test_database_that_is_no_bag_is_refused(tmp_path):
    pytest.importorskip("rosbags")
    base = sqlite3.connect(tmp_path / "a.db3")
    base.execute("CREATE TABLE messages(x)")
    base.close()
    with pytest.raises(DefinitionError, match="is damaged or no ros2 bag database"):
        read_log(tmp_path / "a.db3", ARM)
