"""A log from a CSV file, with the separators, decimal signs and times of other tools."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError, plain
from slidax._files import MEGABYTE, open_file

from .csv_form import Form, form_of, is_number, lines_of
from .log import Log
from .matching import match_columns
from .reading import Reading

MOST_BYTES = 1000 * MEGABYTE
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}


def read_csv(path: Path, joints: Sequence[str], reading: Reading) -> Log:
    """Return the log in a CSV file.

    Columns are separated by commas, semicolons, tabs or spaces, and decimals by a point, or by a comma where no comma
    separates columns; which of them is recognised. Only the columns that are needed must be numbers.

    - `path`: of the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: what the titles do not say.

    Raises DefinitionError, with line and column, if the file has not this form.
    """
    name = f"`{path.name}`"
    with open_file(path, most=MOST_BYTES) as file:
        form = form_of(lines_of(file, name), name)
        columns = match_columns(form.titles, joints, name, reading)
        places = [form.titles.index(title) for title in columns.titles]
        optional = [form.titles.index(title) for title in columns.of.get("dq", [])]
        with closing(lines_of(file, name)) as lines:
            values, notes = _numbers(lines, form, places, optional, name)
    return columns.log(name, joints, dict(zip(columns.titles, values.T, strict=True)), notes)


def _numbers(
    lines: Iterator[tuple[int, str]], form: Form, places: Sequence[int], optional: Sequence[int], name: str
) -> tuple[np.ndarray, list[str]]:
    """The numbers of the columns at these places, the first of which are the times."""
    time = places[0]
    rows, notes = _Rows(lines, form, places, optional, name), list[str]()
    first = next(rows, None)
    if first is None:
        raise DefinitionError(f"{name} names {len(form.titles)} columns, but has no rows of numbers")
    rows.pushed = first
    stamp = Stamp()
    converters: dict[int | str, Callable[[str], float]] | None = None
    entry = first.split("\t")[0]
    if not is_number(entry) and stamp.is_time(entry):
        converters = {0: stamp.seconds}
        notes.append(f"the times in `{plain(form.titles[time])}` are dates: they are counted from the first one")
    try:
        values = np.loadtxt(rows, delimiter="\t", ndmin=2, comments=None, converters=converters)
    except ValueError as error:
        if isinstance(error, DefinitionError):
            raise
        raise rows.wrong_entry(converters is not None) or DefinitionError(
            f"{name} is not a table of numbers: {str(error).partition(chr(10))[0]}"
        ) from None
    return values, notes


class _Rows:
    """The rows of a table with only the columns that are needed, separated by tabs."""

    def __init__(
        self,
        lines: Iterator[tuple[int, str]],
        form: Form,
        places: Sequence[int],
        optional: Sequence[int],
        name: str,
    ) -> None:
        self._lines, self._form, self._places, self._optional, self._name = lines, form, places, optional, name
        self.pushed: str | None = None
        self._last: list[tuple[int, str]] = []

    def __iter__(self) -> _Rows:
        return self

    def __next__(self) -> str:
        if self.pushed is not None:
            row, self.pushed = self.pushed, None
            return row
        for number, line in self._lines:
            if number <= self._form.header or line.startswith("#"):
                continue
            try:
                cells = self._form.cells(line)
            except csv.Error as error:
                raise DefinitionError(f"{self._name}, line {number}: {error}") from None
            self._require_as_many(cells, number)
            row = "\t".join([self._form.number(cells[place]) for place in self._places])
            # numpy reads some rows ahead of the one that it complains about.
            return self._kept(number, row, cells)
        raise StopIteration

    def _kept(self, number: int, row: str, cells: list[str]) -> str:
        for place in self._places:
            if not cells[place]:
                raise DefinitionError(
                    f"{self._name}, line {number}: column `{plain(self._form.titles[place])}` is empty; leave out "
                    f"this line{' or all velocities (`--drop dq`)' if place in self._optional else ''}"
                )
        self._last.append((number, row))
        if len(self._last) > 4:
            del self._last[0]
        return row

    def _require_as_many(self, cells: list[str], number: int) -> None:
        titles = len(self._form.titles)
        if len(cells) == titles or (len(cells) > titles and not any(cells[titles:])):
            return
        if self._form.separator == "," and len(cells) == 2 * titles:
            hint = "; if a comma stands before the decimals, separate the columns by semicolons"
        elif len(cells) < titles:
            hint = "; leave out this line if its writing was interrupted"
        else:
            hint = f"; columns are separated by {_NAMES[self._form.separator]}"
        raise DefinitionError(
            f"{self._name}, line {number}: {len(cells)} entries, but line {self._form.header} names {titles} "
            f"columns{hint}"
        )

    def wrong_entry(self, dates: bool) -> DefinitionError | None:
        """The entry that numpy could not read: the first that is no number in the last rows."""
        for number, row in self._last:
            for place, cell in zip(self._places, row.split("\t"), strict=True):
                date = dates and place == self._places[0]
                if not (Stamp().is_time(cell) if date else is_number(cell)):
                    kind = "date" if date else "number"
                    return DefinitionError(
                        f"{self._name}, line {number}: `{plain(cell)}` in column `{plain(self._form.titles[place])}` "
                        f"is no {kind}; leave out this line, or correct it"
                    )
        return None


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
