"""A log from a CSV file, with the separators, decimal signs and times of other tools."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from datetime import datetime
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np

from slidax._errors import DefinitionError, plain
from slidax._files import MEGABYTE, open_file
from slidax._tables import Form, form_of, is_number, lines_of, rows_of

from .columns import Columns
from .log import Log
from .matching import match_columns
from .reading import Reading
from .titles import INDEX, PLURALS, WORDS, Title

MOST_BYTES = 1000 * MEGABYTE

_NAME = re.compile(r"(?:(?P<prefix>.*)\.)?names?(?:[._]?\[?(?P<index>\d{1,6})\]?)?")
"""The title of a column with the name of a joint, or with a list of names."""


def read_csv(path: Path, joints: Sequence[str], reading: Reading) -> Log:
    """Return the log in a CSV file.

    Columns are separated by commas, semicolons, tabs or spaces, and decimals by a point, or by a comma where no comma
    separates columns; which of them is recognised. Only the columns that are needed must be numbers. Numbered columns
    belong to the joints that other columns name, such as `name0` next to `position0`.

    - `path`: of the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: what the titles do not say.

    Raises DefinitionError, with line and column, if the file has not this form.
    """
    name = f"`{path.name}`"
    with open_file(path, most=MOST_BYTES) as file:
        form = form_of(lines_of(file, name), name, "time,q_1,tau_1")
        joints_in = _joints_in(form, file, name)
        titles = [_renamed(title, joints_in) for title in form.titles] if joints_in else form.titles
        columns = match_columns(titles, joints, name, reading)
        places = [titles.index(title) for title in columns.titles]
        with closing(lines_of(file, name)) as lines:
            values, notes = _csv_numbers(rows_of(lines, form, places, name), columns, name)
    return columns.log(name, joints, dict(zip(columns.titles, values.T, strict=True)), notes)


def _joints_in(form: Form, file: BinaryIO, name: str) -> dict[tuple[str, int], str]:
    """The joints' names in columns of texts, by what stands before in the title and by their number.

    `rostopic echo -p` writes columns `field.name0`, `field.name1`; bagpy writes a list into a column `name`.
    """
    parts = {place: _NAME.fullmatch(Title.of(text).bare.lower()) for place, text in enumerate(form.titles)}
    titles = {place: part for place, part in parts.items() if part is not None}
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


def _renamed(text: str, joints: Mapping[tuple[str, int], str]) -> str:
    """A title with the joint's name in place of its number."""
    title = Title.of(text)
    parts = INDEX.fullmatch(title.bare)
    if parts is None:
        return text
    prefix, _, word = parts["stem"].rpartition(".")
    joint = joints.get((prefix.lower(), int(parts["a"] or parts["b"] or parts["c"])))
    if joint is None or not any(word.lower() in words for words in (*WORDS.values(), PLURALS)):
        return text
    return f"{parts['stem']}.{joint}" + (f" [{title.unit}]" if title.unit else "")


def _csv_numbers(rows: Iterator[tuple[int, list[str]]], columns: Columns, name: str) -> tuple[np.ndarray, list[str]]:
    """The numbers in the rows, the first of each its time, and notes about them."""
    # numpy reads some rows ahead of the one that it complains about.
    last: deque[tuple[int, list[str]]] = deque(maxlen=4)
    optional = columns.of.get("dq", [])

    def lines() -> Iterator[str]:
        for number, cells in rows:
            for title, cell in zip(columns.titles, cells, strict=True):
                if not cell:
                    remedy = " or all velocities (`--drop dq`)" if title in optional else ""
                    raise DefinitionError(
                        f"{name}, line {number}: column `{plain(title)}` is empty; leave out this line{remedy}"
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
        notes.append(f"the times in `{plain(columns.time)}` are dates: they are counted from the first one")
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
                        f"{name}, line {number}: `{plain(cell)}` in column `{plain(title)}` is no "
                        f"{'date' if date else 'number'}; leave out this line, or correct it"
                    ) from None
        raise DefinitionError(f"{name} is not a table of numbers: {str(error).partition(chr(10))[0]}") from None
    return values, notes


_ZONE = re.compile(r"\s*(?:Z|UTC|[-+]\d\d:?\d\d)$")


class Stamp:
    """Dates and times of day as seconds since the first one."""

    def __init__(self) -> None:
        self._first: np.datetime64 | None = None

    def is_time(self, text: str) -> bool:
        """Return True if a text is a date with a time.

        - `text`: an entry.
        """
        return self._moment(text) is not None

    def seconds(self, text: str) -> float:
        """Return the seconds since the first text.

        - `text`: an entry.

        Raises ValueError if a text is no date.
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
