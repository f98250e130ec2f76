"""A log from a file: CSV, Parquet, or messages of ROS, as JSON or in an MCAP file."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, nearest, shown
from slidax.logs import read_joint_states
from slidax.simulation import read_columns

from .columns import Columns
from .log import Log


def read_log(path: str | Path, joints: Sequence[str]) -> Log:
    """The log in a file, by its ending.

    - `path`: `.csv` with a first line that names the columns; `.parquet`, as `slidax run --out` writes it; `.json` or
      `.jsonl` with `sensor_msgs/JointState` messages, in a list or one a line; `.mcap` with such messages of ROS 2 on
      `/joint_states`, as `slidax run`, `slidax loop` and `ros2 bag` write them.
    - `joints`: the arm's joints, in its order.

    Raises DefinitionError if it cannot be read, has another ending, or lacks something.
    """
    path = Path(path)
    if path.suffix not in READERS:
        raise DefinitionError(f"cannot read `{path.name}`: a log ends in {', '.join(READERS)}")
    return READERS[path.suffix](path, joints)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise DefinitionError(f"cannot read the file `{path}`: {reason}") from None


def _from_csv(path: Path, joints: Sequence[str]) -> Log:
    lines = [line for line in _text(path).splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise DefinitionError(f"`{path.name}` is empty: the first line must name the columns, such as `time,q_1,tau_1`")
    titles = [title.strip() for title in next(csv.reader(lines[:1]))]
    columns = Columns.found(titles, joints, f"`{path.name}`")
    try:
        values = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",", ndmin=2)
    except ValueError as error:
        raise DefinitionError(f"`{path.name}` is not a table of numbers: {error}") from None
    if values.shape[1] != len(titles):
        raise DefinitionError(f"`{path.name}` names {len(titles)} columns, but has {values.shape[1]}")
    return columns.log(f"`{path.name}`", joints, dict(zip(titles, values.T, strict=True)))


def _from_parquet(path: Path, joints: Sequence[str]) -> Log:
    table = read_columns(path)
    columns = Columns.found(list(table), joints, f"`{path.name}`")
    wanted = [columns.time, *(title for titles in columns.of.values() for title in titles)]
    try:
        read = {title: table[title].astype(float) for title in wanted}
    except (ValueError, TypeError):
        raise DefinitionError(f"`{path.name}` has columns that are no numbers") from None
    return columns.log(f"`{path.name}`", joints, read)


def _from_joint_states(path: Path, joints: Sequence[str]) -> Log:
    text = _text(path)
    try:
        messages = (
            json.loads(text) if text.lstrip().startswith("[") else [json.loads(x) for x in text.splitlines() if x]
        )
    except json.JSONDecodeError as error:
        raise DefinitionError(
            f"`{path.name}`, line {error.lineno}: not JSON: {error.msg}; a list of messages is needed, or one a line"
        ) from None
    if not messages:
        raise DefinitionError(f"`{path.name}` has no messages")
    return _from_messages(path, joints, messages)


def _from_mcap(path: Path, joints: Sequence[str]) -> Log:
    return _from_messages(path, joints, read_joint_states(path))


def _from_messages(path: Path, joints: Sequence[str], messages: list[Any]) -> Log:
    t = np.empty(len(messages))
    values = {field: np.empty((len(messages), len(joints))) for field in FIELDS}
    has_velocity = True
    for row, message in enumerate(messages):
        where = f"`{path.name}`, message {row + 1}"
        places = _places(message, joints, where)
        t[row] = _stamp(message, where)
        for field in FIELDS:
            given = message.get(field)
            if field == "velocity" and not given:
                has_velocity = False
                continue
            if not isinstance(given, list) or len(given) != len(message["name"]):
                raise DefinitionError(f"{where}: `{field}` must have an entry for each name; got {shown(given)}")
            try:
                values[field][row] = [given[place] for place in places]
            except (TypeError, ValueError):
                raise DefinitionError(f"{where}: `{field}` must be numbers; got {shown(given)}") from None
    velocity = values["velocity"] if has_velocity else None
    return Log(f"`{path.name}`", tuple(joints), t - t[0], values["position"], values["effort"], velocity)


FIELDS = ("position", "velocity", "effort")


def _places(message: Any, joints: Sequence[str], where: str) -> list[int]:
    names = message.get("name") if isinstance(message, dict) else None
    if not isinstance(names, list):
        raise DefinitionError(f"{where}: a `sensor_msgs/JointState` has a list `name`; got {shown(message)}")
    for joint in joints:
        if joint not in names:
            raise DefinitionError(f"{where}: there is no joint `{joint}`; {nearest(joint, map(str, names))}")
    return [names.index(joint) for joint in joints]


def _stamp(message: dict[str, Any], where: str) -> float:
    try:
        stamp = message["header"]["stamp"]
        # Of ROS 2, and of ROS 1.
        small = stamp["nanosec"] if "nanosec" in stamp else stamp["nsecs"]
        return float(stamp["sec"] if "sec" in stamp else stamp["secs"]) + 1e-9 * float(small)
    except (KeyError, TypeError, ValueError):
        raise DefinitionError(f"{where}: there is no `header.stamp` with `sec` and `nanosec`") from None


READERS: dict[str, Callable[[Path, Sequence[str]], Log]] = {
    ".csv": _from_csv,
    ".parquet": _from_parquet,
    ".json": _from_joint_states,
    ".jsonl": _from_joint_states,
    ".mcap": _from_mcap,
}
