import io
import struct

import numpy as np
import pytest

import slidax as sx
from slidax import DefinitionError
from slidax.identify import read_log
from slidax.runtime.logs import read_mcap
from slidax.simulation import parquet

from .whole_files import JOINTS, bag_mcap, cdr, messages

pytest.importorskip("mcap")

MAGIC = b"\x89MCAP0\r\n"


def record(kind, body):
    return struct.pack("<BQ", kind, len(body)) + body


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


PRIVATE = 0x90
"""A kind of record that readers skip."""


def chunk(compression, packed, announced):
    body = struct.pack("<QQQI", 0, 0, announced, 0) + text(compression) + struct.pack("<Q", len(packed)) + packed
    return record(6, body)


def zstd(data):
    return pytest.importorskip("zstandard").compress(data)


def lz4(data):
    return pytest.importorskip("lz4.frame").compress(data)


@pytest.mark.parametrize(("compression", "pack"), [("zstd", zstd), ("lz4", lz4)])
@pytest.mark.parametrize("reader", [read_mcap, lambda path: read_log(path, JOINTS)], ids=["own", "bag"])
def test_mcap_that_unpacks_to_a_thousand_times_its_size_is_refused(tmp_path, compression, pack, reader):
    content = record(PRIVATE, bytes(40_000_000))
    path = tmp_path / "a.mcap"
    path.write_bytes(MAGIC + record(1, text("ros2") + text("x")) + 30 * chunk(compression, pack(content), len(content)))
    with pytest.raises(DefinitionError, match=r"unpacks to more than .* MB, the limit for a log of its size"):
        reader(path)


@pytest.mark.parametrize(("compression", "pack"), [("zstd", zstd), ("lz4", lz4)])
def test_chunk_that_unpacks_to_more_than_its_stated_size_is_refused(tmp_path, compression, pack):
    path = tmp_path / "a.mcap"
    channel = struct.pack("<HH", 1, 0) + text("/camera") + text("cdr") + struct.pack("<I", 0)
    content = record(4, channel) + record(PRIVATE, bytes(50_000_000))
    for announced, topics in ((len(content), "its topics are `/camera`"), (100, "it has no topics")):
        path.write_bytes(MAGIC + record(1, text("ros2") + text("x")) + chunk(compression, pack(content), announced))
        with pytest.raises(DefinitionError, match=f"has no ROS 2 messages with joint states; {topics}"):
            read_log(path, JOINTS)


def test_an_mcap_log_is_read_up_to_a_chunk_with_a_wrong_checksum(tmp_path):
    """Without a checksum, a flipped bit would change a measurement unnoticed."""
    from mcap.writer import CompressionType, Writer

    whole = bag_mcap(chunked=True)
    read = read_log_of(tmp_path, whole)
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE, chunk_size=20_000)
    writer.start(profile="ros2")
    schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
    channel = writer.register_channel("/joint_states", "cdr", schema)

    for k, message in enumerate(messages()):
        writer.add_message(channel, log_time=k, publish_time=k, data=cdr(message))
    writer.finish()
    body = bytearray(out.getvalue())
    assert len(read_log_of(tmp_path, bytes(body)).t) == len(read.t)
    body[len(body) * 96 // 100 - len(body) // 20] ^= 64
    damaged = read_log_of(tmp_path, bytes(body))
    assert any("read up to the damage" in note for note in damaged.notes)
    assert len(damaged.t) < len(read.t)
    np.testing.assert_array_equal(damaged.q, read.q[: len(damaged.t)])


def read_log_of(tmp_path, body):
    (tmp_path / "a.mcap").write_bytes(body)
    return read_log(tmp_path / "a.mcap", JOINTS)


def test_parquet_with_more_values_than_the_limit_is_refused(tmp_path, monkeypatch):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(parquet, "MOST_NUMBERS", parquet.MOST_NUMBERS // 100)
    zeros = pa.array([0.0] * 10_000)
    with pq.ParquetWriter(tmp_path / "a.parquet", pa.schema([(n, pa.float64()) for n in TITLES])) as writer:
        for _ in range(25):
            writer.write_table(pa.table(dict.fromkeys(TITLES, zeros)))
    assert (tmp_path / "a.parquet").stat().st_size < 1e5
    with pytest.raises(DefinitionError, match="250000 rows"):
        read_log(tmp_path / "a.parquet", JOINTS)


TITLES = ("time", "q_1", "q_2", "tau_1", "tau_2")


def test_parquet_lists_with_too_many_entries_are_refused(tmp_path, monkeypatch):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(parquet, "MOST_NUMBERS", 100_000)
    columns = {"time": np.arange(300.0), "position": [[0.0] * 500] * 300, "effort": [[0.0] * 500] * 300}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet", compression="zstd")
    with pytest.raises(DefinitionError, match="it has 300 rows"):
        parquet.read_table(tmp_path / "a.parquet", lambda schema, sizes: list(schema.names))


@pytest.mark.parametrize("kind", ["string", "binary", "struct<x: int64>", "list<element: double>", "dictionary"])
def test_a_saved_run_with_a_column_that_is_not_numeric_is_refused(tmp_path, kind):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    text = pa.array(["a" * 1000] * 20)
    column = {"struct<x: int64>": [{"x": 1}] * 20, "list<element: double>": [[1.0, 2.0]] * 20, "string": text}.get(kind)
    if column is None:
        column = text.dictionary_encode() if kind == "dictionary" else text.cast(pa.binary())
    pq.write_table(pa.table({"t": np.arange(20.0), "q_1": column}), tmp_path / "a.parquet")
    with pytest.raises(DefinitionError, match=f"column `q_1` has the type {kind}.*, which is not numeric"):
        parquet.read_columns(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", b"[" * 200_000),
        ("a.json", b'[{"a":' * 100_000),
        ("a.jsonl", b'{"name": [' + b"1," * 2_000_000 + b"1]}"),
        (
            "a.json",
            b'[{"header": {"stamp": {"sec": ' + b"9" * 400 + b', "nanosec": 0}}, "name": ["shoulder", "elbow"]}]',
        ),
        (
            "a.json",
            b'[{"header": {"stamp": {"sec": ' + b"9" * 5000 + b', "nanosec": 0}}, "name": ["shoulder", "elbow"]}]',
        ),
        ("a.csv", b"time,q_1,q_2,tau_1,tau_2\n0,0,0,0," + b"1" * 1_100_000),
        ("a.csv", b'time,q_1,q_2,tau_1,tau_2\n0,0,0,0,"' + b"1" * 200_000 + b'"'),
        ("a.csv", b"x" * 200_000 + b",q_1\n0,1\n"),
        ("a.csv", b"time,q_1,q_2,tau_1,tau_2\n0,0,0,0\0,0\n"),
        ("a.csv", b"a," * 400_000 + b"\n"),
    ],
    ids=["brackets", "braces", "list", "400 digits", "5000 digits", "line", "field", "title", "zero", "columns"],
)
def test_a_large_malformed_log_is_refused_with_a_short_message(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DefinitionError) as error:
        read_log(tmp_path / name, JOINTS)
    assert len(str(error.value).splitlines()) == 1 and len(str(error.value)) < 700


@pytest.mark.parametrize("number", ["9" * 400, "9" * 5000, "-1e400"])
@pytest.mark.parametrize("place", ["position", "time", "sec"])
def test_joint_trajectory_with_a_number_of_many_digits_is_refused(number, place):
    values = {"position": "0", "time": '{"sec": 0, "nanosec": 0}'} | (
        {"time": f'{{"sec": {number}, "nanosec": 0}}'} if place == "sec" else {place: number}
    )
    point = f'{{"positions": [{values["position"]}], "time_from_start": {values["time"]}}}'
    last = '{"positions": [1], "time_from_start": 2}'
    message = f'{{"joint_names": ["a"], "points": [{point}, {last}]}}'
    quantity = "position of joint `a`" if place == "position" else "time"
    with pytest.raises(DefinitionError, match=rf"points\[0\]: the {quantity} must be a finite number"):
        sx.motions.Tabulated.from_joint_trajectory(message)


def test_a_deeply_nested_joint_trajectory_is_refused():
    with pytest.raises(DefinitionError, match="nested too deeply"):
        sx.motions.Tabulated.from_joint_trajectory('{"points": ' + "[" * 200_000)
