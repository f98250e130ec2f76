"""Logs from `sensor_msgs/JointState` messages, matched by joint name."""

from __future__ import annotations

import io
import json
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from slidax.core.errors import DefinitionError, nearest_word, plain_name, short_repr
from slidax.core.files import MEGABYTE, open_file, parse_integer
from slidax.core.joint_names import match_names

from .logs import JointLog, ReadOptions

FIELDS = {"position": "q", "velocity": "dq", "effort": "tau"}
"""Fields of a `sensor_msgs/JointState`, and the quantity in each: position, velocity or torque."""

MOST_BYTES = 1000 * MEGABYTE
"""Largest size of a log in text form."""

LONGEST_MESSAGE = MEGABYTE
"""Largest number of characters of a message in a JSON text."""


def log_of_messages(
    source: str, joints: Sequence[str], messages: Iterable[Any], reading: ReadOptions, notes: Sequence[str] = ()
) -> JointLog:
    """Return the log in joint-state messages.

    Joints are matched by name. Messages without any of the arm's joints come from another publisher and are left out.
    Velocities count as not measured if a message lacks them, or if all are zero while the arm moves.

    - `source`: name of the log, for errors and notes.
    - `joints`: the arm's joints, in its order.
    - `messages`: the messages, as mappings.
    - `reading`: fields to take or to drop.
    - `notes`: notes of the file's reader, which come first.

    Raises DefinitionError, with the number of the message, if a message is incomplete; also if no message has the arm's
    joints.
    """
    fields = _fields(reading)
    times, values = array("d"), {quantity: array("d") for quantity in fields.values()}
    columns_of: dict[tuple[str, ...], list[int] | None] = {}
    others: Counter[str] = Counter()
    origin: tuple[int, int] | None = None
    total = lost = 0
    for row, message in enumerate(messages, 1):
        total += 1
        where = f"{source}, message {row}"
        names = _names(message, where)
        if names not in columns_of:
            columns_of[names] = _joint_indices(names, joints, where)
            taken = columns_of[names]
            others.update(name for index, name in enumerate(names) if taken is not None and index not in taken)
        indices = columns_of[names]
        if indices is None:
            lost += 1
            continue
        second, billionth = _stamp(message, where)
        origin = origin or (second, billionth)
        times.append((second - origin[0]) + 1e-9 * (billionth - origin[1]))
        for field, quantity in fields.items():
            entries = message.get(field)
            if quantity == "dq" and (quantity not in values or not _is_list(entries) or not len(entries)):
                values.pop("dq", None)
                continue
            values[quantity].extend(_numbers(entries, indices, len(names), f"{where}: `{field}`"))
    notes = [*notes, *(f"`{name}` is left out, as `drop` says" for name in reading.drop if name in FIELDS.values())]
    if not total:
        raise DefinitionError(f"{source} has no messages")
    if not times:
        known = list(dict.fromkeys(name for key in columns_of for name in key))
        listed = ", ".join(f"`{plain_name(name)}`" for name in known[:12])
        raise DefinitionError(
            f"{source} has none of the arm's joints, such as `{joints[0]}`: its messages have {listed}; rename the "
            "joints in the log or in the arm's file"
        )
    if lost:
        notes.append(f"{lost} of {total} messages come from another publisher, without the arm's joints: left out")
    extra = [name for name in others if name not in reading.drop]
    if extra:
        notes.append(f"the arm has no joint {', '.join(f'`{plain_name(name)}`' for name in extra[:8])}: left out")
    columns = {name: np.frombuffer(numbers).reshape(len(times), len(joints)) for name, numbers in values.items()}
    if "dq" in columns and not columns["dq"].any() and np.ptp(columns["q"]) > 0.0:
        del columns["dq"]
        notes.append("all velocities are 0 while the arm moves: they are taken as not measured")
    return JointLog(
        source, tuple(joints), np.array(times), columns["q"], columns["tau"], columns.get("dq"), tuple(notes)
    )


def read_json(path: Path, joints: Sequence[str], reading: ReadOptions) -> JointLog:
    """Return the log in a JSON file: a list of messages, or one message per line.

    - `path`: the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: fields to take or to drop.

    Raises DefinitionError if the file has another form.
    """
    name = f"`{path.name}`"
    with open_file(path, most=MOST_BYTES) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig")
        return log_of_messages(name, joints, _messages(text, name), reading)


def _messages(text: TextIO, name: str) -> Iterator[Any]:
    """Yield the messages one by one, so that only numbers stay in memory."""
    decoder = json.JSONDecoder(parse_int=parse_integer)
    window, start, ended, line, within = "", 0, False, 1, None
    try:
        while True:
            if not ended and len(window) - start < 2 * LONGEST_MESSAGE:
                line += window.count("\n", 0, start)
                read = text.read(2 * LONGEST_MESSAGE)
                window, start, ended = window[start:] + read, 0, not read
            while start < len(window) and window[start] in " \t\r\n,":
                start += 1
            if start == len(window):
                if not ended:
                    continue
                if within:
                    raise _broken(name, line + window.count("\n"), "the list has no end")
                return
            if within is None:
                within = window[start] == "["
                start += within
                continue
            if within and window[start] == "]":
                return
            try:
                message, end = decoder.raw_decode(window, start)
            except json.JSONDecodeError as error:
                if len(window) - start > LONGEST_MESSAGE and error.pos - start > LONGEST_MESSAGE:
                    raise _broken(name, line, f"a message is longer than {LONGEST_MESSAGE} characters") from None
                raise _broken(name, line + window.count("\n", 0, error.pos), error.msg) from None
            start = end
            yield message
    except UnicodeDecodeError:
        raise DefinitionError(f"cannot read the file {name}: it is not UTF-8 text") from None
    except (RecursionError, ValueError) as error:
        if isinstance(error, DefinitionError):
            raise
        raise _broken(name, line, "it is nested too deeply, or a number has too many digits") from None


def _broken(name: str, line: int, why: str) -> DefinitionError:
    return DefinitionError(
        f"{name}, line {line}: not JSON: {why}; a list of messages is needed, or one message per line"
    )


def _fields(reading: ReadOptions) -> dict[str, str]:
    """Return the quantity of each field that is read."""
    fields = dict(FIELDS)
    for quantity, field in reading.columns.items():
        if not isinstance(field, str) or field not in FIELDS or quantity == "t":
            raise DefinitionError(
                f"`columns` gives `{short_repr(field)}` for `{quantity}`, but a JointState has only the fields "
                "`position`, `velocity` and `effort`"
            )
        fields = {name: other for name, other in fields.items() if other != quantity} | {field: quantity}
    for name in reading.drop:
        fields = {field: quantity for field, quantity in fields.items() if name not in (quantity, field)}
    for needed in ("q", "tau"):
        if needed not in fields.values():
            raise DefinitionError(
                f"no field of the messages is left for `{needed}`: `columns` must not use a field twice, nor `drop` "
                "leave its field out"
            )
    return fields


def _names(message: Any, where: str) -> tuple[str, ...]:
    names: Any = message.get("name") if isinstance(message, Mapping) else None
    if not _is_list(names) or not all(isinstance(name, str) for name in names):
        raise DefinitionError(f"{where}: a `sensor_msgs/JointState` has a list `name`; got {short_repr(message)}")
    return tuple(names)


def _joint_indices(names: tuple[str, ...], joints: Sequence[str], where: str) -> list[int] | None:
    """Indices of the arm's joints in the names; None if the names have none of them."""
    indices = match_names(names, joints)
    if not indices:
        return None
    missing = [joint for joint in joints if joint not in indices]
    if missing:
        others = [name for index, name in enumerate(names) if index not in indices.values()]
        near = nearest_word(missing[0], others) if others else "lock it in the robot file if it is not measured"
        raise DefinitionError(f"{where}: there is no joint {', '.join(f'`{joint}`' for joint in missing)}; {near}")
    for joint in joints:
        if names.count(joint) > 1:
            raise DefinitionError(f"{where}: the joint `{joint}` occurs {names.count(joint)} times; name it once")
    return [indices[joint] for joint in joints]


def _numbers(entries: Any, indices: Sequence[int], count: int, where: str) -> list[float]:
    if not _is_list(entries) or len(entries) != count:
        raise DefinitionError(f"{where} must have an entry for each name; got {short_repr(entries)}")
    try:
        return [_number(entries[index]) for index in indices]
    except (TypeError, ValueError, OverflowError):
        raise DefinitionError(f"{where} must be numbers; got {short_repr(entries)}") from None


def _number(entry: Any) -> float:
    if isinstance(entry, (bool, str, np.bool_)):
        raise TypeError
    return float(entry)


def _is_list(value: Any) -> bool:
    return isinstance(value, (list, tuple, np.ndarray))


def _stamp(message: Mapping[str, Any], where: str) -> tuple[int, int]:
    """Seconds and nanoseconds of a ROS 2 or ROS 1 message's time stamp."""
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else None
    if isinstance(stamp, Mapping):
        for seconds, billionths in (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec")):
            parts: Any = (stamp.get(seconds), stamp.get(billionths))
            if all(isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts):
                second, billionth = parts
                if abs(second) < 1e12 and abs(billionth) < 1e12 and second == int(second):
                    return int(second), int(billionth)
    raise DefinitionError(
        f"{where}: `header.stamp` needs `sec` and `nanosec` as whole numbers; got the header {short_repr(header)}"
    )
