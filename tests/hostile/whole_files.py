"""A small whole file of each kind that is read."""

import io
import json
import sqlite3
import struct
import tempfile
import warnings
from pathlib import Path

import numpy as np

from slidax.scenarios.load import BUILT_IN

ROOT = Path(__file__).parents[2]
JOINTS = ("shoulder", "elbow")
SAMPLES = 220


def columns():
    t = 0.01 * np.arange(SAMPLES)
    q = np.stack([0.3 * np.sin(3 * t), 0.2 * np.cos(2 * t)], axis=1)
    return {"time": t, **{f"q_{i + 1}": q[:, i] for i in range(2)}, **{f"tau_{i + 1}": 5 * q[:, i] for i in range(2)}}


def csv_log():
    table = columns()
    rows = [",".join(table), *(",".join(f"{x:.5g}" for x in row) for row in zip(*table.values(), strict=True))]
    return "\n".join(rows).encode()


def semicolon_log():
    return csv_log().replace(b",", b";").replace(b".", b",")


def dated_log():
    lines = csv_log().decode().splitlines()
    dated = [f'"2024-05-01 10:00:{float(line.split(",")[0]):09.6f}",{line.partition(",")[2]}' for line in lines[1:]]
    return "\n".join([lines[0], *dated]).encode()


def messages():
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


def parquet_log(compression="none"):
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = columns()
    stamps = pa.array((1e6 * table.pop("time")).astype(np.int64), pa.timestamp("us"))
    arrays = {"time": stamps, **{name: pa.array(column) for name, column in table.items()}}
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(arrays), sink, compression=compression)
    return bytes(sink.getvalue())


def cdr(message):
    """A joint state as ROS 2 sends it, written here by the standard and not by the code under test."""
    body = bytearray()

    def aligned(size):
        body.extend(bytes(-len(body) % size))

    def text(value):
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


def bag_mcap(compression="NONE", *, chunked=False):
    """An MCAP file by the package mcap. Without checksums, so that damage reaches what lies behind them."""
    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(
        out, compression=CompressionType[compression], use_chunking=chunked, enable_crcs=False, chunk_size=20_000
    )
    writer.start(profile="ros2")
    definition = b"std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", definition)
    channel = writer.register_channel("/joint_states", "cdr", schema)
    for k, message in enumerate(messages()):
        writer.add_message(channel, log_time=k, publish_time=k, data=cdr(message))
    writer.finish()
    return out.getvalue()


def bag_database():
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


def own_log():
    """A log as `slidax run` writes it, without chunks, so that damage reaches what is in it."""
    from slidax.runtime.logs import Channels, LogWriter

    rng, rows = np.random.default_rng(1), 20
    channels = Channels(JOINTS, ("rad", "rad"), {"s": 2, "u": 2}, True, ("HELD", "LIMITED"))
    scenario = (BUILT_IN / "example-4.1-1khz.yaml").read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        writer = LogWriter(path, channels, {"scenario": "x", "seconds": "0.02"}, {"scenario.yaml": scenario})
        for side, write in ((channels.law(), writer.law), (channels.arm(), writer.arm)):
            fields = [field for message in side for field in message.fields]
            shapes = {field.key: (rows,) if field.count is None else (rows, field.count) for field in fields}
            table = {name: rng.integers(0, 2, shape) for name, shape in shapes.items()}
            write(table | {name: 1e-3 * np.arange(rows) for name in ("t", "true_t")})
        writer.close()
        return unpacked(path.read_bytes())


def unpacked(data):
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


def saved_run():
    import pyarrow as pa
    import pyarrow.parquet as pq

    t = 1e-3 * np.arange(21)
    names = [f"{name}_{k}" for name in ("q", "dq", "q_d", "e", "tau", "lower", "upper") for k in (1, 2)]
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table({"k": np.arange(21), "t": t, **dict.fromkeys(names, np.sin(t))}), sink)
    return bytes(sink.getvalue())


def motion_csv():
    t = np.linspace(0, 2, 21)
    rows = ["time,shoulder,elbow", *(f"{x:.3g},{0.1 * x:.4g},{-0.2 * x:.4g}" for x in t)]
    return "\n".join(rows).encode()


def semicolon_motion():
    return motion_csv().replace(b",", b";").replace(b".", b",")


def joint_trajectory():
    points = [
        {"positions": [0.1 * k, -0.1 * k], "velocities": [], "time_from_start": {"sec": k, "nanosec": 0}}
        for k in range(5)
    ]
    return json.dumps({"joint_names": list(JOINTS), "points": points}).encode()


def path_csv():
    rows = ["time,x,y,z,qw,qx,qy,qz", *(f"{k},0.{k},0.1,0.2,1,0,0,0" for k in range(1, 9))]
    return "\n".join(rows).encode()


def mesh_stl():
    triangle = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    return bytes(80) + struct.pack("<I", 12) + 12 * triangle


def mesh_obj():
    return b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1/1/1 3 4\n"


def mesh_dae():
    import trimesh

    with warnings.catch_warnings():
        # pycollada is older than its NumPy.
        warnings.simplefilter("ignore", DeprecationWarning)
        return trimesh.exchange.dae.export_collada(trimesh.creation.box())
