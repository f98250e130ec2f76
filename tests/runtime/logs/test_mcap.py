import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.runtime.logs import (
    Channels,
    LogWriter,
    Message,
    MessageField,
    joint_state,
    names_of_bits,
    read_joint_states,
    read_mcap,
)
from tests.cli.commands import in_process

pytest.importorskip("foxglove")
pytest.importorskip("mcap")
ros2 = pytest.importorskip("mcap_ros2.decoder")

CHANNELS = Channels(("shoulder", "élbow"), ("rad", "rad"), {"s": 2, "u": None, "disturbance": 2}, True, ("BAD", "LATE"))
ROWS = 700


def columns(messages, rng, t_name, t):
    actual = {}
    for message in messages:
        for field in message.fields:
            shape = (ROWS,) if field.count is None else (ROWS, field.count)
            if field.kind == "float64":
                actual[field.key] = rng.normal(size=shape)
            else:
                actual[field.key] = rng.integers(0, 2 if field.kind == "bool" else 1000, shape)
    return actual | {t_name: t}


def written(path, rng, *, close=True):
    t = 1e-3 * np.arange(ROWS)
    law, arm = columns(CHANNELS.law(), rng, "t", t), columns(CHANNELS.arm(), rng, "true_t", t)
    law["q"][3, 1] = np.nan
    attachments = {"scenario.yaml": b"title: none", "robot-arm.urdf": b"<robot/>"}
    writer = LogWriter(path, CHANNELS, {"scenario": "x"}, attachments, start=1_700_000_000_000_000_000)
    for first in range(0, ROWS, 100):
        writer.law({name: column[first : first + 100] for name, column in law.items()})
        writer.arm({name: column[first : first + 100] for name, column in arm.items()})
        writer.flush()
    if close:
        writer.close()
    return law, arm, writer


def test_log_is_read_back_bit_for_bit(tmp_path):
    law, arm, _ = written(tmp_path / "log.mcap", np.random.default_rng(1))
    read = read_mcap(tmp_path / "log.mcap")
    assert read.complete and read.channels == CHANNELS and read.metadata["scenario"] == "x"
    assert read.scenario == "title: none" and read.files == {"robot-arm.urdf": b"<robot/>"}
    for actual, expected in ((read.law, law), (read.arm, arm)):
        assert set(actual) == set(expected)
        for name, column in expected.items():
            np.testing.assert_array_equal(actual[name], column)


def test_mcap_ros2_decodes_a_message_to_the_same_values():
    rng = np.random.default_rng(2)
    message = Message(
        "/x",
        "slidax_msgs/msg/X",
        (
            *(MessageField("flag", "bool"), MessageField("a", "float64", 3), MessageField("n", "uint32")),
            *(MessageField("k", "int64"), MessageField("f", "bool")),
        ),
        ("one", "näme"),
    )
    expected = {
        "flag": np.array([True, False]),
        "a": rng.normal(size=(2, 3)),
        "n": np.array([7, 8]),
        "k": np.array([-1, 1 << 40]),
        "f": np.array([False, True]),
    }
    packed = message.packed(np.array([1_500_000_000, 7]), expected)
    schema = SimpleNamespace(id=1, name=message.type, encoding="ros2msg", data=message.definition.encode())
    decode = ros2.DecoderFactory().decoder_for("cdr", schema)
    for row, body in enumerate(packed):
        text = decode(body)
        assert list(text.name) == ["one", "näme"] and list(text.a) == expected["a"][row].tolist()
        assert (text.flag, text.n, text.k, text.f) == tuple(expected[name][row] for name in ("flag", "n", "k", "f"))
    assert (decode(packed[0]).header.stamp.sec, decode(packed[0]).header.stamp.nanosec) == (1, 500_000_000)


def test_ros_2_joint_states_of_a_log_are_read_back(tmp_path):
    law, _, _ = written(tmp_path / "log.mcap", np.random.default_rng(3))
    messages = list(read_joint_states(tmp_path / "log.mcap").messages)
    assert len(messages) == ROWS and messages[5]["name"] == ["shoulder", "élbow"]
    assert messages[5]["position"] == law["q"][5].tolist()
    assert messages[5]["effort"] == law["effort"][5].tolist()
    assert messages[5]["header"]["stamp"] == {"sec": 1_700_000_000, "nanosec": 5_000_000}


def test_truncated_log_is_read_up_to_its_end(tmp_path):
    law, _, writer = written(tmp_path / "log.mcap", np.random.default_rng(4), close=False)
    body = (tmp_path / "log.mcap").read_bytes()
    read = read_mcap(tmp_path / "log.mcap")
    assert not read.complete
    np.testing.assert_array_equal(read.law["q"], law["q"])
    counts = []
    for share in np.linspace(0.2, 0.97, 23):
        (tmp_path / "cut.mcap").write_bytes(body[: int(share * len(body))])
        cut = read_mcap(tmp_path / "cut.mcap")
        rows = len(cut.law["k"])
        np.testing.assert_array_equal(cut.law["tau"], law["tau"][:rows])
        assert rows % 100 == 0 and not cut.complete
        counts.append(rows)
    assert counts == sorted(counts) and counts[0] < 200 and counts[-1] == ROWS - 100
    writer.close()


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "is no MCAP file"), (b"t,q1\n0,1\n", "is no MCAP file"), (None, "cannot read the file")],
)
def test_file_that_is_no_log_is_refused(tmp_path, content, words):
    if content is not None:
        (tmp_path / "log.mcap").write_bytes(content)
    with pytest.raises(DefinitionError, match=words):
        read_mcap(tmp_path / "log.mcap")


@pytest.mark.parametrize("command", ["replay", "explain"])
def test_log_whose_scenario_is_not_text_is_refused_in_one_line(tmp_path, command):
    path = tmp_path / "flip.mcap"
    writer = LogWriter(path, CHANNELS, {"scenario": "x"}, {"scenario.yaml": b"title: n\xefne"}, start=0)
    writer.close()
    result = in_process(command, str(path), code=2)
    lines = result.output.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("slidax: ") and "flip.mcap" in lines[0] and "scenario.yaml" in lines[0]
    assert "no UTF-8 text" in lines[0]


def test_joint_states_of_other_software_are_read_but_refused_as_a_slidax_log(tmp_path):
    import foxglove

    context = foxglove.Context()
    with foxglove.open_mcap(tmp_path / "other.mcap", context=context):
        message = joint_state("/joint_states", ("a",), ("q", "dq", "tau"))
        schema = foxglove.Schema(name=message.type, encoding="ros2msg", data=message.definition.encode())
        channel = foxglove.Channel(message.topic, schema=schema, message_encoding="cdr", context=context)
        numbers = {name: np.array([[0.5]]) for name in ("q", "dq", "tau")}
        channel.log(message.packed(np.array([0]), numbers)[0], log_time=0)
    assert next(read_joint_states(tmp_path / "other.mcap").messages)["position"] == [0.5]
    with pytest.raises(DefinitionError, match="no ROS 2 joint states on the topic `/x`"):
        read_joint_states(tmp_path / "other.mcap", "/x")
    with pytest.raises(DefinitionError, match="is not a slidax log"):
        read_mcap(tmp_path / "other.mcap")


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("foxglove", lambda path: LogWriter(path, CHANNELS, {}, {})),
        ("mcap.stream_reader", read_mcap),
        ("mcap_ros2.decoder", read_joint_states),
    ],
)
def test_missing_package_is_reported_in_one_line_with_the_remedy(tmp_path, monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(DefinitionError, match=r"which is not installed: pip install 'slidax\[log\]'"):
        call(tmp_path / "x.mcap")


def test_live_data_has_the_channels_of_the_log():
    connect = pytest.importorskip("websockets.sync.client").connect
    import json

    port = 18765
    writer = LogWriter(None, CHANNELS, {}, {}, port=port)
    try:
        with pytest.raises(DefinitionError, match=f"cannot start a server at 127.0.0.1:{port}"):
            LogWriter(None, CHANNELS, {}, {}, port=port)
        with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], proxy=None) as socket:
            topics = {}
            while len(topics) < 8:
                text = json.loads(socket.recv(timeout=10))
                topics |= {channel["topic"]: channel["id"] for channel in text.get("channels", ())}
            assert set(topics) == {message.topic for message in (*CHANNELS.law(), *CHANNELS.arm())}
    finally:
        writer.close()


def test_status_bits_are_listed_by_name():
    assert names_of_bits(("BAD", "LATE"), 2) == ["LATE"]
    assert names_of_bits(("BAD", "LATE"), 3) == ["BAD", "LATE"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no such device")
@pytest.mark.parametrize("large", [False, True])
def test_a_full_disk_is_an_error_with_the_name_of_the_file_and_no_panic(large, capfd):
    rng, t = np.random.default_rng(5), 1e-3 * np.arange(ROWS)
    writer = LogWriter(Path("/dev/full"), CHANNELS, {"x": "y" * (100_000 if large else 1)}, {})
    writer.law(columns(CHANNELS.law(), rng, "t", t))
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"):
        writer.flush()
    with pytest.raises(OSError, match="No space left on device"):
        writer.close()
    assert "panic" not in capfd.readouterr().err


@pytest.mark.skipif(shutil.which("rerun") is None, reason="no rerun here (pip install rerun-sdk)")
def test_rerun_reads_every_channel(tmp_path):
    written(tmp_path / "log.mcap", np.random.default_rng(5))
    done = subprocess.run(
        ["rerun", "mcap", "check", "log.mcap"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    rows = [line.split() for line in done.stdout.splitlines() if " /" in line]
    assert {row[3] for row in rows} == {message.topic for message in (*CHANNELS.law(), *CHANNELS.arm())}
    assert all(row[0] == "ok" and int(row[2]) > 0 for row in rows), done.stdout
    convert = ["rerun", "mcap", "convert", "log.mcap", "-o", "log.rrd"]
    converted = subprocess.run(convert, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "/joint_states/position" in converted.stdout + converted.stderr
