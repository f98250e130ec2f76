"""`sensor_msgs/JointState` messages from ROS 2 logs: MCAP files, and folders of `ros2 bag`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from slidax._errors import DefinitionError, nearest, plain
from slidax._names import matched

from .message import joint_state
from .needed import require_reader
from .records import read_contents

TYPES = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
TOPIC = "/joint_states"
"""The usual topic."""

OWN = "/truth"
"""Topic of simulated arms in slidax's logs, meant for display."""


@dataclass(frozen=True)
class JointStates:
    """Messages of one topic.

    - `messages`: as mappings, decoded one by one.
    - `notes`: sentences about skipped content.
    """

    topic: str
    messages: Iterator[dict[str, Any]]
    notes: tuple[str, ...] = ()


def read_joint_states(path: Path, topic: str | None = None, joints: Sequence[str] = ()) -> JointStates:
    """Return the joint states in an MCAP file from any writer.

    - `topic`: by default the only one whose first messages have the joints, or `/joint_states`.
    - `joints`: names that the messages must have.

    Raises DefinitionError if it cannot be read, has no such messages or several topics with them, or a package is
    missing.
    """
    require_reader()
    decode = decoder()
    contents = read_contents(path, TYPES)
    notes = () if contents.whole else ("the file is incomplete or damaged: it is read up to the damage",)
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
    """Return the joint states of the requested topic, or of the only one that has the joints.

    - `source`: the log's name in messages.
    - `bodies`: undecoded messages by topic.
    - `topics`: all topics of the log.
    - `decode`: from an undecoded message to an object.

    Raises DefinitionError if there is none, or there are several.
    """
    if topic is not None:
        if topic not in bodies:
            kind = "has the topic, but no joint states on it" if topic in topics else "has no such topic"
            raise DefinitionError(
                f"{source} has no messages of ROS 2 on the topic `{plain(topic)}`: it {kind}; "
                f"{nearest(topic, bodies) if bodies else _no_joint_states(topics)}"
            )
        return JointStates(topic, _decoded(source, bodies[topic], decode), tuple(notes))
    if not bodies:
        raise DefinitionError(f"{source} has no messages of ROS 2 with joint states; {_no_joint_states(topics)}")
    with_joints = [name for name, messages in bodies.items() if _has_joints(source, messages, joints, decode)]
    chosen = TOPIC if TOPIC in with_joints or (not with_joints and TOPIC in bodies) else None
    others = [name for name in with_joints or list(bodies) if name != chosen and name != OWN]
    if chosen is None and len(others) == 1:
        chosen, others = others[0], []
    if chosen is None and not others:
        chosen = OWN
    if chosen is None:
        names = ", ".join(f"`{plain(name)}`" for name in sorted(others)[:12])
        raise DefinitionError(
            f"{source} has joint states on {len(others)} topics, {names}: choose one (`--topic {sorted(others)[0]}`)"
        )
    notes = list(notes)
    if chosen != TOPIC:
        notes.append(f"reading topic `{plain(chosen)}`, the only one with joint states of the arm")
    elif others:
        names = ", ".join(f"`{plain(name)}`" for name in sorted(others)[:8])
        notes.append(f"reading topic `{TOPIC}`; joint states also on {names} (`--topic`)")
    return JointStates(chosen, _decoded(source, bodies[chosen], decode), tuple(notes))


def _no_joint_states(topics: set[str]) -> str:
    names = ", ".join(f"`{plain(name)}`" for name in sorted(topics)[:12])
    return f"its topics are {names}" if names else "there are none"


def _has_joints(source: str, messages: Sequence[bytes], joints: Sequence[str], decode: Any) -> bool:
    """True if one of the first messages, possibly from several publishers, has all joints."""
    return any(
        len(matched(message["name"], joints)) == len(joints) for message in _decoded(source, messages[:20], decode)
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
    """Return a decoder of joint states by slidax's own definition, as a file's definition may be anything.

    Raises DefinitionError if its package is missing.
    """
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise DefinitionError(
            "reading messages of ROS 2 needs mcap-ros2-support, which is not installed: pip install 'slidax[log]'"
        ) from None
    message = joint_state(TOPIC, ("a",), ("q", "dq", "effort"))
    schema: Any = SimpleNamespace(id=1, name=message.type, encoding="ros2msg", data=message.definition.encode())
    return DecoderFactory().decoder_for("cdr", schema)
