"""Every reader of files, with a small whole file of each kind that it reads."""

from __future__ import annotations

import json
import sqlite3
import struct
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import slidax as sx
from slidax.scenarios.load import BUILT_IN
from slidax.simulation.columns import columns_of

ROOT = Path(__file__).parents[2]
JOINTS = ("shoulder", "elbow")
SAMPLES = 220


@dataclass(frozen=True)
class Reader:
    """A reader.

    - `name`: of it.
    - `file`: under which it looks for the damaged content, below a folder.
    - `content`: of a whole file.
    - `read`: given the path.
    - `text`: whether it reads text.
    - `beside`: writes whatever else it needs into the folder.
    """

    name: str
    file: str
    content: Callable[[], bytes]
    read: Callable[[Path], Any]
    text: bool = True
    beside: Callable[[Path], None] = lambda folder: None


def columns() -> dict[str, np.ndarray]:
    t = 0.01 * np.arange(SAMPLES)
    q = np.stack([0.3 * np.sin(3 * t), 0.2 * np.cos(2 * t)], axis=1)
    return {
        "time": t,
        **{f"q_{i + 1}": q[:, i] for i in range(2)},
        **{f"tau_{i + 1}": 5 * q[:, i] for i in range(2)},
    }


def csv_log() -> bytes:
    table = columns()
    rows = [",".join(table), *(",".join(f"{x:.5g}" for x in row) for row in zip(*table.values(), strict=True))]
    return "\n".join(rows).encode()


def semicolon_log() -> bytes:
    return csv_log().replace(b",", b";").replace(b".", b",")


def dated_log() -> bytes:
    lines = csv_log().decode().splitlines()
    dated = [f'"2024-05-01 10:00:{float(line.split(",")[0]):09.6f}",{line.partition(",")[2]}' for line in lines[1:]]
    return "\n".join([lines[0], *dated]).encode()


def messages() -> list[dict[str, Any]]:
    table = columns()
    return [
        {
            "header": {"stamp": {"sec": 5 + int(t), "nanosec": round(1e9 * (t % 1))}},
            "name": ["elbow", "shoulder", "finger"],
            "position": [table["q_2"][k], table["q_1"][k], 0.0],
            "velocity": [],
            "effort": [table["tau_2"][k], table["tau_1"][k], 0.0],
        }
        for k, t in enumerate(table["time"].tolist())
    ]


def parquet_log(compression: str = "none") -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = columns()
    stamps = pa.array((1e6 * table.pop("time")).astype(np.int64), pa.timestamp("us"))
    arrays = {"time": stamps, **{name: pa.array(column) for name, column in table.items()}}
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(arrays), sink, compression=compression)
    return bytes(sink.getvalue())


def cdr(message: dict[str, Any]) -> bytes:
    """A joint state as ROS 2 sends it, written here by the standard and not by the code under test."""
    body = bytearray()

    def aligned(size: int) -> None:
        body.extend(bytes(-len(body) % size))

    def text(value: str) -> None:
        aligned(4)
        body.extend(struct.pack("<I", len(value) + 1) + value.encode() + b"\0")

    body.extend(struct.pack("<iI", message["header"]["stamp"]["sec"], message["header"]["stamp"]["nanosec"]))
    text("")
    aligned(4)
    body.extend(struct.pack("<I", len(message["name"])))
    for name in message["name"]:
        text(name)
    for field in ("position", "velocity", "effort"):
        aligned(4)
        body.extend(struct.pack("<I", len(message[field])))
        if message[field]:
            aligned(8)
            body.extend(struct.pack(f"<{len(message[field])}d", *message[field]))
    return b"\0\1\0\0" + bytes(body)


def bag_mcap(
    compression: str = "NONE", *, chunked: bool = False, topics: tuple[str, ...] = ("/joint_states",)
) -> bytes:
    """An MCAP file by the package mcap. Without checksums, so that damage reaches what lies behind them."""
    import io

    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(
        out, compression=CompressionType[compression], use_chunking=chunked, enable_crcs=False, chunk_size=20_000
    )
    writer.start(profile="ros2")
    definition = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", definition)
    channels = [writer.register_channel(topic, "cdr", schema) for topic in topics]
    for k, message in enumerate(messages()):
        for channel in channels:
            writer.add_message(channel, log_time=k, publish_time=k, data=cdr(message))
    writer.finish()
    return out.getvalue()


def bag_database() -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag.db3"
        base = sqlite3.connect(path)
        base.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        base.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
            "data BLOB NOT NULL)"
        )
        base.execute("INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '')")
        base.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)",
            [(k, cdr(message)) for k, message in enumerate(messages())],
        )
        base.commit()
        base.close()
        return path.read_bytes()


BAG_METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: mcap
  relative_file_paths:
    - bag_0.mcap
  duration: {nanoseconds: 2190000000}
  starting_time: {nanoseconds_since_epoch: 0}
  message_count: 220
"""


@cache
def own_log() -> bytes:
    """A log of a run, short and uncompressed, so that damage reaches what is in it."""
    import tempfile

    from slidax.deploy.robot_loop import lockstep, write_stepped

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        scenario = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 0.02})
        write_stepped(scenario, lockstep(scenario, 20), path)
        return unpacked(path.read_bytes())


def unpacked(data: bytes) -> bytes:
    """The same MCAP file without chunks and checksums."""
    import io

    from mcap.stream_reader import StreamReader
    from mcap.writer import Writer

    out = io.BytesIO()
    writer = Writer(out, use_chunking=False, enable_crcs=False, repeat_channels=False)
    writer.start(profile="ros2")
    schemas, channels = {}, {}
    for record in StreamReader(io.BytesIO(data)).records:
        kind = type(record).__name__
        if kind == "Schema":
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif kind == "Channel" and record.id not in channels:
            channels[record.id] = writer.register_channel(record.topic, "cdr", schemas[record.schema_id])
        elif kind == "Message":
            writer.add_message(channels[record.channel_id], record.log_time, record.data, record.publish_time)
        elif kind == "Metadata":
            writer.add_metadata(record.name, record.metadata)
        elif kind == "Attachment":
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
    writer.finish()
    return out.getvalue()


@cache
def saved_run() -> bytes:
    """The log of a folder that `slidax run --out` has written."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    run = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 0.02}).simulate()
    table = columns_of(run, ["_1", "_2"])
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table({name: np.asarray(column) for name, (column, _) in table.items()}), sink)
    return bytes(sink.getvalue())


def motion_csv() -> bytes:
    t = np.linspace(0, 2, 21)
    rows = ["time,shoulder,elbow", *(f"{x:.3g},{0.1 * x:.4g},{-0.2 * x:.4g}" for x in t)]
    return "\n".join(rows).encode()


def joint_trajectory() -> bytes:
    points = [
        {"positions": [0.1 * k, -0.1 * k], "velocities": [], "time_from_start": {"sec": k, "nanosec": 0}}
        for k in range(5)
    ]
    return json.dumps({"joint_names": list(JOINTS), "points": points}).encode()


def path_csv() -> bytes:
    rows = ["time,x,y,z,qw,qx,qy,qz", *(f"{k},0.{k},0.1,0.2,1,0,0,0" for k in range(1, 9))]
    return "\n".join(rows).encode()


def mesh_stl() -> bytes:
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    return bytes(80) + struct.pack("<I", 12) + 12 * triangle


def mesh_obj() -> bytes:
    return b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1/1/1 3 4\n"


def mesh_dae() -> bytes:
    import trimesh

    with warnings.catch_warnings():
        # pycollada is older than its NumPy.
        warnings.simplefilter("ignore", DeprecationWarning)
        return trimesh.exchange.dae.export_collada(trimesh.creation.box())


def read_mesh(path: Path) -> Any:
    from slidax.robots.files import Shape
    from slidax.views import meshes

    shape = Shape("a", "mesh", np.eye(4), np.ones(3), None, path.name, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            return meshes._meshes(shape)
    except sx.DefinitionError:
        raise
    except Exception:
        # `mesh_solids` names such a mesh in a warning.
        return None


def log_of(path: Path) -> Any:
    from slidax.identification import read_log

    return read_log(path, JOINTS)


def replayed(path: Path) -> Any:
    from slidax.logs import read_mcap
    from slidax.scenarios import of_log

    log = read_mcap(path)
    return of_log(log)


def explained(path: Path) -> Any:
    from slidax.diagnosis import read_saved

    return read_saved(path.parent)


def with_scenario(folder: Path) -> None:
    (folder / "scenario.yaml").write_bytes((BUILT_IN / "example-4.1-1khz.yaml").read_bytes())


def with_mcap(folder: Path) -> None:
    (folder / "bag_0.mcap").write_bytes(bag_mcap())


def with_metadata(folder: Path) -> None:
    (folder / "metadata.yaml").write_text(BAG_METADATA, encoding="utf-8")


def example(name: str) -> Callable[[], bytes]:
    return (ROOT / "examples" / name).read_bytes


def all_readers() -> Iterator[Reader]:
    """Every reader; what a machine lacks is left out by those that ask."""
    from slidax.commissioning import draft
    from slidax.design import read_requirements
    from slidax.kinematics import Through
    from slidax.scenarios import named_robot
    from slidax.scenarios.load import described
    from slidax.studies import read_rows, read_study
    from slidax.studies.stored import read_identity
    from slidax.trajectories.csv_table import csv_table
    from slidax.trajectories.joint_trajectory_table import joint_trajectory_table

    def folder(path: Path) -> Any:
        return log_of(path.parent)

    def rows(path: Path) -> Any:
        return read_rows(path.parent)

    yield Reader("scenario", "a.yaml", (BUILT_IN / "example-4.1-1khz.yaml").read_bytes, described)
    yield Reader("tool path scenario", "a.yaml", (BUILT_IN / "panda-pick.yaml").read_bytes, described)
    yield Reader("study", "a.yaml", example("studies/example-4.1-1khz.yaml"), read_study)
    yield Reader("requirements", "a.yaml", example("design/two-link.yaml"), read_requirements)
    yield Reader("motion", "a.csv", motion_csv, lambda path: csv_table(path, JOINTS))
    yield Reader("joint trajectory", "a.json", joint_trajectory, lambda path: joint_trajectory_table(path, JOINTS))
    yield Reader("tool path", "a.csv", path_csv, Through.from_csv)
    yield Reader("urdf", "a.urdf", example("robots/two_link.urdf"), sx.robots.from_urdf)
    yield Reader("mjcf", "a.xml", example("robots/two_link.xml"), sx.robots.from_mjcf)
    yield Reader("drawn urdf", "a.urdf", example("robots/two_link.urdf"), draft)
    yield Reader("robot", "a.yaml", lambda: b"robot: {kind: panda}\n", lambda path: named_robot(str(path)))
    yield Reader("stl mesh", "a.stl", mesh_stl, read_mesh, text=False)
    yield Reader("obj mesh", "a.obj", mesh_obj, read_mesh)
    yield Reader("dae mesh", "a.dae", mesh_dae, read_mesh)
    yield Reader("csv log", "a.csv", csv_log, log_of)
    yield Reader("semicolon log", "a.csv", semicolon_log, log_of)
    yield Reader("dated log", "a.csv", dated_log, log_of)
    yield Reader("json log", "a.json", lambda: json.dumps(messages()).encode(), log_of)
    yield Reader("jsonl log", "a.jsonl", lambda: "\n".join(map(json.dumps, messages())).encode(), log_of)
    yield Reader("parquet log", "a.parquet", parquet_log, log_of, text=False)
    yield Reader("packed parquet log", "a.parquet", lambda: parquet_log("snappy"), log_of, text=False)
    yield Reader("mcap log", "a.mcap", bag_mcap, log_of, text=False)
    yield Reader("chunked mcap log", "a.mcap", lambda: bag_mcap(chunked=True), log_of, text=False)
    yield Reader("zstd mcap log", "a.mcap", lambda: bag_mcap("ZSTD", chunked=True), log_of, text=False)
    yield Reader("lz4 mcap log", "a.mcap", lambda: bag_mcap("LZ4", chunked=True), log_of, text=False)
    yield Reader("bag database", "a.db3", bag_database, log_of, text=False)
    yield Reader("bag metadata", "bag/metadata.yaml", BAG_METADATA.encode, folder, beside=with_mcap)
    yield Reader("bag folder", "bag/bag_0.mcap", bag_mcap, folder, text=False, beside=with_metadata)
    yield Reader("own log", "a.mcap", own_log, replayed, text=False)
    yield Reader("own log to explain", "a.mcap", own_log, lambda path: explained(path / "x"), text=False)
    yield Reader("saved run", "run/log.parquet", saved_run, explained, text=False, beside=with_scenario)
    yield Reader("rows", "study/rows.parquet", lambda: parquet_log("zstd"), rows, text=False)
    yield Reader(
        "identity", "study/study.json", lambda: b'{"scenario": {"a": 1}}', lambda path: read_identity(path.parent)
    )
