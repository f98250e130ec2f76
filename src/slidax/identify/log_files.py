"""Logs from files: CSV, Parquet, JSON, MCAP and ros2 bag folders."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from slidax.core.errors import DefinitionError, plain_name
from slidax.core.files import open_file
from slidax.core.tables import TableFormat, is_number, lines_of, rows_of, table_format
from slidax.runtime.logs.ros_bags import read_bag, read_joint_states
from slidax.simulation import parquet

from .column_titles import INDEX, PLURALS, WORDS, Title, match_columns
from .joint_states import MOST_BYTES, log_of_messages, read_json
from .logs import TIME_UNITS, JointLog, LogColumns, ReadOptions

_NAME = re.compile(r"(?:(?P<prefix>.*)\.)?names?(?:[._]?\[?(?P<index>\d{1,6})\]?)?")
"""Title of a column with the name of a joint, or with a list of names."""


def read_csv(path: Path, joints: Sequence[str], reading: ReadOptions) -> JointLog:
    """Return the log in a CSV file.

    The separator (comma, semicolon, tab or space) and the decimal sign (point, or a comma if the separator is another)
    are detected. Only the columns that are read must be numeric. If columns such as `name0` have the joints' names,
    then numbered columns such as `position0` belong to these joints.

    - `path`: the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: the user's choices where titles are ambiguous.

    Raises DefinitionError, with line and column, if the file has another form.
    """
    name = f"`{path.name}`"
    with open_file(path, most=MOST_BYTES) as file:
        form = table_format(lines_of(file, name), name, "time,q_1,tau_1")
        joint_names = _name_columns(form, file, name)
        titles = [_with_joint_name(title, joint_names) for title in form.titles] if joint_names else form.titles
        columns = match_columns(titles, joints, name, reading)
        indices = [titles.index(title) for title in columns.titles]
        with closing(lines_of(file, name)) as lines:
            values, notes = _csv_numbers(rows_of(lines, form, indices, name), columns, name)
    return columns.log(name, joints, dict(zip(columns.titles, values.T, strict=True)), notes)


def _name_columns(form: TableFormat, file: BinaryIO, name: str) -> dict[tuple[str, int], str]:
    """Return joint names from text columns, by the prefix of the column's title and the joint's number.

    `rostopic echo -p` writes columns `field.name0`, `field.name1`; bagpy writes a list into a column `name`.
    """
    parts = {index: _NAME.fullmatch(Title.of(text).bare.lower()) for index, text in enumerate(form.titles)}
    titles = {index: part for index, part in parts.items() if part is not None}
    joints: dict[tuple[str, int], str] = {}
    if not titles:
        return joints
    with closing(lines_of(file, name)) as lines:
        for number, cells in rows_of(lines, form, list(titles), name):
            own: dict[tuple[str, int], str] = {}
            for part, cell in zip(titles.values(), cells, strict=True):
                prefix = part["prefix"] or ""
                if part["index"]:
                    own[prefix, int(part["index"])] = cell
                elif cell.startswith("["):
                    words = cell.strip("[]").split(",")
                    own |= {(prefix, index): word.strip(" '\"") for index, word in enumerate(words)}
            joints = joints or own
            if own != joints:
                raise DefinitionError(
                    f"{name}, line {number}: the names of the joints differ from those above: write a column for each "
                    "joint, such as `elbow.position`"
                )
            if not own:
                break
    return joints


def _with_joint_name(text: str, joints: Mapping[tuple[str, int], str]) -> str:
    """Replace the joint's number in a title by the joint's name."""
    title = Title.of(text)
    parts = INDEX.fullmatch(title.bare)
    if parts is None:
        return text
    prefix, _, word = parts["stem"].rpartition(".")
    joint = joints.get((prefix.lower(), int(parts["a"] or parts["b"] or parts["c"])))
    if joint is None or not any(word.lower() in words for words in (*WORDS.values(), PLURALS)):
        return text
    return f"{parts['stem']}.{joint}" + (f" [{title.unit}]" if title.unit else "")


def _csv_numbers(rows: Iterator[tuple[int, list[str]]], columns: LogColumns, name: str) -> tuple[np.ndarray, list[str]]:
    """Return the numbers in the rows, with the times in the first column, and notes about conversions."""
    # NumPy reads a few rows ahead of the row in its error.
    last: deque[tuple[int, list[str]]] = deque(maxlen=4)
    optional = columns.of.get("dq", [])

    def lines() -> Iterator[str]:
        for number, cells in rows:
            for title, cell in zip(columns.titles, cells, strict=True):
                if not cell:
                    remedy = " or all velocities (`--drop dq`)" if title in optional else ""
                    raise DefinitionError(
                        f"{name}, line {number}: column `{plain_name(title)}` is empty; leave out this line{remedy}"
                    )
            last.append((number, cells))
            yield "\t".join(cells)

    texts = lines()
    first = next(texts, None)
    if first is None:
        raise DefinitionError(f"{name} has titles, but no rows of numbers below them")
    stamp = Stamp()
    entry = last[0][1][0]
    notes, converters = list[str](), dict[int | str, Callable[[str], float]]()
    if not is_number(entry) and stamp.is_time(entry):
        converters[0] = stamp.seconds
        notes.append(f"the times in `{plain_name(columns.time)}` are dates: they are counted from the first one")
    try:
        values = np.loadtxt(
            chain([first], texts), delimiter="\t", ndmin=2, comments=None, converters=converters or None
        )
    except DefinitionError:
        raise
    except ValueError as error:
        for number, cells in last:
            for title, cell in zip(columns.titles, cells, strict=True):
                date = bool(converters) and title == columns.time
                if not (stamp.is_time(cell) if date else is_number(cell)):
                    raise DefinitionError(
                        f"{name}, line {number}: `{plain_name(cell)}` in column `{plain_name(title)}` is no "
                        f"{'date' if date else 'number'}; leave out this line, or correct it"
                    ) from None
        raise DefinitionError(f"{name} is not a table of numbers: {str(error).partition(chr(10))[0]}") from None
    return values, notes


_ZONE = re.compile(r"\s*(?:Z|UTC|[-+]\d\d:?\d\d)$")


class Stamp:
    """Conversion of dates with times of day to seconds since the first converted date."""

    def __init__(self) -> None:
        self._first: np.datetime64 | None = None

    def is_time(self, text: str) -> bool:
        """True if a text is a date with a time of day."""
        return self._moment(text) is not None

    def seconds(self, text: str) -> float:
        """Return the seconds since the first date.

        - `text`: a date with a time of day.

        Raises ValueError if the text is no date.
        """
        moment = self._moment(text)
        if moment is None:
            raise ValueError(text)
        if self._first is None:
            self._first = moment
        return float((moment - self._first) / np.timedelta64(1, "ns")) * 1e-9

    def _moment(self, text: str) -> np.datetime64 | None:
        text = text.strip()
        zone = _ZONE.search(text)
        bare = text[: zone.start()] if zone is not None and ":" in text[: zone.start()] else text
        if not re.fullmatch(r"\d{4}[-/]\d\d?[-/]\d\d?[ T_]\d\d?:\d\d(?::\d\d(?:[.,]\d{1,9})?)?", bare):
            return None
        try:
            date, clock = re.split(r"[ T_]", bare.replace("/", "-"), maxsplit=1)
            year, month, day = date.split("-")
            hour, _, rest = clock.replace(",", ".").partition(":")
            moment = np.datetime64(f"{year}-{month:0>2}-{day:0>2}T{hour:0>2}:{rest}", "ns")
            if zone is not None and zone[0].strip() not in ("Z", "UTC"):
                offset = datetime.fromisoformat(f"2000-01-01T00:00{zone[0].strip()}").utcoffset()
                moment = moment - np.timedelta64(int(offset.total_seconds()) if offset else 0, "s")
            return moment
        except ValueError:
            return None


def read_parquet(path: Path, joints: Sequence[str], reading: ReadOptions) -> JointLog:
    """Return the log in a Parquet file of `slidax run --out` or another tool.

    Timestamps are converted by the unit of their type; decimals and dictionaries of numbers become numbers. A list
    column is split into columns such as `position[0]`, or `position.elbow` if a column `name` lists the joints' names,
    as in messages.

    - `path`: the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: the user's choices where titles are ambiguous.

    Raises DefinitionError, with the column, if a column has another type or lacks a value.
    """
    name = f"`{path.name}`"
    order = _joint_names(path, name)
    columns: list[LogColumns] = []
    lists: dict[str, tuple[str, int]] = {}

    def choose(schema: Any, sizes: dict[str, int]) -> list[str]:
        titles: list[str] = []
        for title in schema.names:
            if title in sizes:
                named = len(order) == sizes[title]
                parts = [f"{title}.{order[k]}" if named else f"{title}[{k}]" for k in range(sizes[title])]
                lists.update({part: (title, index) for index, part in enumerate(parts)})
                titles += parts
            else:
                titles.append(title)
        columns.append(match_columns(titles, joints, name, reading))
        return list(dict.fromkeys(lists.get(title, (title, 0))[0] for title in columns[0].titles))

    table = parquet.read_table(path, choose)
    chosen = columns[0]
    values: dict[str, np.ndarray] = {}
    notes: list[str] = []
    for title in chosen.titles:
        list_title, index = lists.get(title, (title, None))
        column = table.column(list_title)
        if index is not None:
            column = parquet.element(column, index)
        values[title], note = _parquet_numbers(column, title, name, is_time=title == chosen.time)
        notes += [note] if note else []
        if note and title == chosen.time:
            # The times are in s already: undo the factor of the title's unit, which `log` will apply.
            values[title] = values[title] / chosen.scale[title]
    return chosen.log(name, joints, values, notes)


def _joint_names(path: Path, source: str) -> tuple[str, ...]:
    """Return the joint names listed in a column `name`; empty if there is no such column."""
    title, orders = parquet.read_text_lists(path, ("name", "joint_names"))
    if len(orders) > 1:
        raise DefinitionError(
            f"{source}: the names in column `{plain_name(title)}` differ from row to row: write a column "
            "for each joint, such as `elbow.position`"
        )
    return next(iter(orders), ())


def _parquet_numbers(column: Any, title: str, name: str, *, is_time: bool) -> tuple[np.ndarray, str]:
    """Return a column as numbers, time stamps as seconds since the first, and a note about a conversion."""
    import pyarrow as pa
    import pyarrow.compute as pc

    where = f"{name}: column `{plain_name(title)}`"
    if column.null_count:
        row = int(pc.index(pc.is_null(column), True).as_py()) + 1
        raise DefinitionError(
            f"{where} has no value in row {row}; leave out this row, or the column if it is not needed"
        )
    kind = column.type
    if pa.types.is_dictionary(kind):
        column = column.cast(kind.value_type)
        kind = kind.value_type
    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind):
        if not is_time:
            raise DefinitionError(f"{where} has times ({kind}), where numbers are needed")
        ticks = column.cast(pa.int64()).to_numpy()
        seconds = (ticks - ticks[:1]) * TIME_UNITS[kind.unit]
        return seconds, f"the times in `{plain_name(title)}` are {kind}: they are counted from the first one"
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        numbers = column.to_numpy()
        if is_time and pa.types.is_integer(kind) and len(numbers) and abs(int(numbers[0])) > 2**53:
            # Subtract as integers: floating-point numbers of this size have steps of hundreds.
            numbers = numbers.astype(np.int64) - np.int64(numbers[0])
        return numbers.astype(float), ""
    if pa.types.is_decimal(kind):
        return column.cast(pa.float64()).to_numpy(), ""
    raise DefinitionError(f"{where} has the type {kind}, which is not numeric: write it as float64")


def read_log(
    path: str | Path,
    joints: Sequence[str],
    *,
    topic: str | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    drop: Sequence[str] = (),
) -> JointLog:
    """Read a log from a file; its suffix selects the format.

        log = read_log("bag.mcap", arm.joint_names, topic="/robot1/joint_states", drop=["dq"])

    Joints are matched by name if the log has names. The log's `notes` list data that was left out or converted.

    - `path`: `.csv` (also `.tsv`, `.txt`) with a title line; `.parquet`, as `slidax run --out` writes it; `.json` or
      `.jsonl` with `sensor_msgs/JointState` messages, in a list or one per line; `.mcap` with such messages of ROS 2,
      as `slidax run`, `slidax loop` and `ros2 bag` write them; a `ros2 bag` folder, or its `.db3`.
    - `joints`: the arm's joints, in its order.
    - `topic`: topic to read, if the log has several with joint states.
    - `columns`: the word in the column titles of `t`, `q`, `dq` or `tau`, such as `{"tau": "effort"}`, or a list with
      a title per joint.
    - `drop`: quantities (`dq`), columns, joints by name, or joints by their number in the log, to leave out.

    Raises DefinitionError if the file cannot be read, has another suffix, or is incomplete.
    """
    path = Path(path)
    reading = ReadOptions(topic, dict(columns or {}), tuple(drop))
    reader = _from_bag if path.is_dir() else READERS.get(path.suffix.lower())
    if reader is None:
        raise DefinitionError(
            f"cannot read `{path.name}`: a log's name must end in {', '.join(READERS)}, or be a ros2 bag folder"
        )
    if topic is not None and reader not in (_from_mcap, _from_bag):
        raise DefinitionError(f"`{path.name}` has no topics: leave `topic` out")
    return reader(path, joints, reading)


def _from_mcap(path: Path, joints: Sequence[str], reading: ReadOptions) -> JointLog:
    states = read_joint_states(path, reading.topic, joints)
    return log_of_messages(f"`{path.name}`", joints, states.messages, reading, states.notes)


def _from_bag(path: Path, joints: Sequence[str], reading: ReadOptions) -> JointLog:
    states = read_bag(path, reading.topic, joints)
    return log_of_messages(f"`{path.name}`", joints, states.messages, reading, states.notes)


READERS: dict[str, Callable[[Path, Sequence[str], ReadOptions], JointLog]] = {
    ".csv": read_csv,
    ".tsv": read_csv,
    ".txt": read_csv,
    ".parquet": read_parquet,
    ".json": read_json,
    ".jsonl": read_json,
    ".mcap": _from_mcap,
    ".db3": _from_bag,
}
