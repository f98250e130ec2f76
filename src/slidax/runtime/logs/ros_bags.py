"""Joint states from ROS 2 recordings: MCAP files, bag folders and SQLite databases."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from slidax.core.errors import DefinitionError, nearest_word, plain_name
from slidax.core.files import MEGABYTE, open_file, read_text, require_file
from slidax.core.joint_names import match_names

from .mcap_files import read_contents, require_package, require_reader
from .messages import joint_state

TYPES = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
TOPIC = "/joint_states"
"""The usual topic of joint states."""

OWN = "/truth"
"""Topic in slidax's logs with the true state of the simulated arm; read only if no other topic has joint states."""


@dataclass(frozen=True)
class JointStates:
    """Joint states on one topic of a recording.

    - `messages`: `sensor_msgs/JointState` messages as nested dictionaries, decoded one by one.
    - `notes`: sentences about the chosen topic and about content that was not read.
    """

    topic: str
    messages: Iterator[dict[str, Any]]
    notes: tuple[str, ...] = ()


def read_joint_states(path: str | Path, topic: str | None = None, joints: Sequence[str] = ()) -> JointStates:
    """Return the joint states on one topic of an MCAP file from any writer.

    - `topic`: the topic; by default `/joint_states`, or the only topic whose first messages have the joints.
    - `joints`: joint names by which the topic is chosen, if `topic` is None.

    Raises DefinitionError if the file cannot be read, has no such messages or several topics with them, or a package is
    missing.
    """
    require_reader()
    decode = decoder()
    path = Path(path)
    contents = read_contents(path, TYPES)
    notes = () if contents.complete else ("the file is incomplete or damaged: it is read up to the damage",)
    return choose_topic(f"`{path.name}`", contents.bodies, contents.topics, topic, joints, decode, notes)


def choose_topic(
    source: str,
    bodies: dict[str, list[bytes]],
    topics: set[str],
    topic: str | None,
    joints: Sequence[str],
    decode: Any,
    notes: Sequence[str],
) -> JointStates:
    """Return the joint states on the requested topic; without a request, on `/joint_states` or the only suitable topic.

    - `source`: name of the recording, for errors.
    - `bodies`: undecoded joint-state messages by topic.
    - `topics`: all topics of the recording.
    - `topic`: the requested topic; None: a topic whose first messages have all `joints`.
    - `decode`: decodes a message to an object.
    - `notes`: notes on the recording, to which the choice is added.

    Raises DefinitionError if no topic or several topics qualify.
    """
    if topic is not None:
        if topic not in bodies:
            kind = "has the topic, but no joint states on it" if topic in topics else "has no such topic"
            raise DefinitionError(
                f"{source} has no ROS 2 joint states on the topic `{plain_name(topic)}`: it {kind}; "
                f"{nearest_word(topic, bodies) if bodies else _no_joint_states(topics)}"
            )
        return JointStates(topic, _decoded(source, bodies[topic], decode), tuple(notes))
    if not bodies:
        raise DefinitionError(f"{source} has no ROS 2 messages with joint states; {_no_joint_states(topics)}")
    with_joints = [name for name, messages in bodies.items() if _has_joints(source, messages, joints, decode)]
    chosen = TOPIC if TOPIC in with_joints or (not with_joints and TOPIC in bodies) else None
    others = [name for name in with_joints or list(bodies) if name != chosen and name != OWN]
    if chosen is None and len(others) == 1:
        chosen, others = others[0], []
    if chosen is None and not others:
        chosen = OWN
    if chosen is None:
        names = ", ".join(f"`{plain_name(name)}`" for name in sorted(others)[:12])
        raise DefinitionError(
            f"{source} has joint states on {len(others)} topics, {names}: choose one (`--topic {sorted(others)[0]}`)"
        )
    notes = list(notes)
    if chosen != TOPIC:
        owner = " of the arm" if chosen in with_joints else ""
        notes.append(f"reading topic `{plain_name(chosen)}`, the only one with joint states{owner}")
    elif others:
        names = ", ".join(f"`{plain_name(name)}`" for name in sorted(others)[:8])
        notes.append(f"reading topic `{TOPIC}`; other topics with joint states: {names} (choose by `--topic`)")
    return JointStates(chosen, _decoded(source, bodies[chosen], decode), tuple(notes))


def _no_joint_states(topics: set[str]) -> str:
    names = ", ".join(f"`{plain_name(name)}`" for name in sorted(topics)[:12])
    return f"its topics are {names}" if names else "it has no topics"


def _has_joints(source: str, messages: Sequence[bytes], joints: Sequence[str], decode: Any) -> bool:
    """True if one of the first messages, possibly from several publishers, has all joints."""
    return any(
        len(match_names(message["name"], joints)) == len(joints) for message in _decoded(source, messages[:20], decode)
    )


def _decoded(source: str, messages: Sequence[bytes], decode: Any) -> Iterator[dict[str, Any]]:
    for number, body in enumerate(messages, 1):
        try:
            message = decode(body)
            stamp = {"sec": message.header.stamp.sec, "nanosec": message.header.stamp.nanosec}
            parts = {name: list(getattr(message, name)) for name in ("name", "position", "velocity", "effort")}
        # The decoder raises any kind of error on damaged bytes.
        except Exception:
            raise DefinitionError(
                f"{source}, message {number}: not a `sensor_msgs/JointState`: damaged or of another type"
            ) from None
        yield {"header": {"stamp": stamp}, **parts}


def decoder() -> Any:
    """Return a function that decodes a CDR-encoded `sensor_msgs/JointState` message to an object.

    It uses slidax's own definition of the type, since the definition in a file may be wrong.

    Raises DefinitionError if mcap-ros2-support is not installed.
    """
    package = require_package("mcap_ros2.decoder", "mcap-ros2-support", "reading ROS 2 messages")
    message = joint_state(TOPIC, ("a",), ("q", "dq", "effort"))
    schema: Any = SimpleNamespace(id=1, name=message.type, encoding="ros2msg", data=message.definition.encode())
    return package.DecoderFactory().decoder_for("cdr", schema)


METADATA = "metadata.yaml"
ENDINGS = (".mcap", ".db3")
MOST_BYTES = 8000 * MEGABYTE
MOST_UNPACKED, RATIO = 4000 * MEGABYTE, 30
"""Limits of a file's unpacked size [bytes]: `MOST_UNPACKED`, and 64 MB plus `RATIO` times its packed size."""

LONGEST_MESSAGE = MEGABYTE
"""Largest size of a joint-state message [bytes]."""


def read_bag(path: str | Path, topic: str | None = None, joints: Sequence[str] = ()) -> JointStates:
    """Return the joint states on one topic of a `ros2 bag` folder, or of one of its `.db3` databases.

    Reads MCAP and SQLite storage, also compressed with zstd. Without a readable `metadata.yaml`, which ros2 bag writes
    at the end of a recording, the folder's files are read in the order of their numbers.

    - `topic`, `joints`: as in `read_joint_states`.

    Raises DefinitionError if the bag cannot be read, has no such messages or several topics with them, or a package is
    missing.
    """
    decode = decoder()
    path = Path(path)
    source = f"`{path.name}`"
    notes: list[str] = []
    bodies: dict[str, list[bytes]] = {}
    topics: set[str] = set()
    with tempfile.TemporaryDirectory(prefix="slidax-") as folder:
        for listed in _files(path, notes):
            file = _unpacked(listed, folder) if listed.suffix == ".zstd" else listed
            if file.suffix == ".mcap":
                contents = read_contents(file, TYPES)
                part, names = contents.bodies, contents.topics
                if not contents.complete:
                    notes.append(f"`{file.name}` is incomplete or damaged: it is read up to the damage")
            else:
                part, names = _states_in_database(file)
            topics |= names
            for name, messages in part.items():
                bodies.setdefault(name, []).extend(messages)
    return choose_topic(source, bodies, topics, topic, joints, decode, notes)


def _files(path: Path, notes: list[str]) -> list[Path]:
    """Files of a bag in order."""
    if not path.is_dir():
        return [path]
    listed = _listed(path)
    if listed is None:
        notes.append(f"`{path.name}` has no readable `{METADATA}`: all of its files are read")
        files = [
            file for file in path.iterdir() if file.name.removesuffix(".zstd").endswith(ENDINGS) and file.is_file()
        ]
        listed = sorted(files, key=lambda file: (_number(file), file.name))
    missing = [file.name for file in listed if len(file.name) > 255 or not file.is_file()]
    if missing:
        raise DefinitionError(
            f"`{path.name}` lacks the file `{plain_name(missing[0])}`, which its `{METADATA}` names: copy it there"
        )
    if not listed:
        raise DefinitionError(
            f"`{path}` is not a ros2 bag folder: it has neither `{METADATA}` nor a {' or '.join(ENDINGS)} file"
        )
    return listed


def _number(file: Path) -> int:
    numbers = re.findall(r"\d{1,9}", Path(file.name.removesuffix(".zstd")).stem)
    return int(numbers[-1]) if numbers else 0


def _listed(path: Path) -> list[Path] | None:
    """Files that the metadata lists; None without a readable list."""
    from ruamel.yaml import YAML

    try:
        text = read_text(path / METADATA, most=MEGABYTE // 4)
        data = YAML(typ="safe", pure=True).load(text)
        names = data["rosbag2_bagfile_information"]["relative_file_paths"]
        # Use only the file's name: a bag must not lead to files outside its folder.
        files = [path / Path(name).name for name in names]
    # YAML readers raise all kinds of errors, and a bag can be read without its metadata.
    except Exception:
        return None
    return files or None


def _unpacked(file: Path, folder: str) -> Path:
    """Decompress a file into another folder."""
    import zstandard

    target = Path(folder) / file.stem
    most = min(MOST_UNPACKED, 64 * MEGABYTE + RATIO * require_file(file, most=MOST_BYTES))
    with open_file(file, most=MOST_BYTES) as packed, target.open("wb") as out:
        try:
            with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as stream:
                while part := stream.read(MEGABYTE):
                    if out.tell() > most:
                        raise DefinitionError(
                            f"`{file.name}` unpacks to more than {most / MEGABYTE:.3g} MB, the limit for a file of "
                            "this size: unpack it first, by `zstd -d`"
                        )
                    out.write(part)
        except zstandard.ZstdError as error:
            raise DefinitionError(f"`{file.name}` is damaged: {error}") from None
    return target


def _states_in_database(file: Path) -> tuple[dict[str, list[bytes]], set[str]]:
    """Raw joint states of a database by topic, and all of its topics."""
    reader = require_package("rosbags.rosbag2", "rosbags", "reading ros2 bag databases").Reader
    require_file(file, most=MOST_BYTES)
    if file.suffix != ".db3":
        raise DefinitionError(
            f"`{plain_name(file.name)}` has an unknown storage format; known file endings: {' and '.join(ENDINGS)}"
        )
    bodies: dict[str, list[bytes]] = {}
    try:
        with reader(file) as bag:
            topics = {connection.topic for connection in bag.connections}
            wanted = [connection for connection in bag.connections if connection.msgtype in TYPES]
            for connection, data in _messages(bag, wanted):
                bodies.setdefault(connection.topic, []).append(data)
    except DefinitionError:
        raise
    # The database packages raise any kind of error on damaged bytes.
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise DefinitionError(f"`{file.name}` is damaged or no ros2 bag database: {reason}") from None
    return bodies, topics


def _messages(bag: Any, wanted: Sequence[Any]) -> Iterator[tuple[Any, bytes]]:
    import zstandard

    if not wanted:
        return
    for connection, _, data in bag.messages(connections=wanted):
        if data[:4] == b"\x28\xb5\x2f\xfd":
            # Each message is compressed separately.
            with zstandard.ZstdDecompressor(max_window_size=1 << 23).stream_reader(data) as stream:
                data = stream.read(LONGEST_MESSAGE)
        yield connection, data
