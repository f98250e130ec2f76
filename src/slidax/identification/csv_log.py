"""A log from a CSV file, with the separators, decimal signs and times of other tools."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np

from slidax._errors import DefinitionError, plain
from slidax._files import MEGABYTE, open_file

from .columns import Columns, Reading
from .log import Log

MOST_BYTES = 1000 * MEGABYTE
LONGEST_LINE = 10**6
"""Characters."""

SAMPLE = 100
"""Lines from which the separator and the decimal sign are recognised."""

_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?|[-+]?\d+,(?:[eE][-+]?\d+)?")
_ZONE = re.compile(r"\s*(?:Z|UTC|[-+]\d\d:?\d\d)$")
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}


@dataclass(frozen=True)
class _Form:
    """The form of a table.

    - `separator`: of its columns; " " for any white space.
    - `comma`: whether decimals follow a comma.
    - `quoted`: whether there are quotation marks.
    - `titles`: of its columns.
    - `header`: number of the line with the titles.
    """

    separator: str
    comma: bool
    quoted: bool
    titles: list[str]
    header: int

    def cells(self, line: str) -> list[str]:
        """The entries of a line."""
        if self.separator == " ":
            return line.split() if not self.quoted else next(csv.reader([" ".join(line.split())], delimiter=" "))
        if not self.quoted:
            return [cell.strip() for cell in line.split(self.separator)]
        return [cell.strip() for cell in next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))]

    def number(self, cell: str) -> str:
        """An entry with a decimal point."""
        return cell.replace(",", ".") if self.comma else cell


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
        form = _form(_lines(file, name), name)
        columns = Columns.match(form.titles, joints, name, reading)
        places = [form.titles.index(title) for title in columns.titles]
        with closing(_lines(file, name)) as lines:
            values, notes = _numbers(lines, form, places, name)
    return columns.log(name, joints, dict(zip(columns.titles, values.T, strict=True)), notes)


def _lines(file: BinaryIO, name: str) -> Generator[tuple[int, str], None, None]:
    """The lines that are neither empty nor comments, with their numbers, from the start of the file."""
    file.seek(0)
    encoding = "utf-16" if file.read(2) in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    file.seek(0)
    text = io.TextIOWrapper(file, encoding=encoding)
    number = 0
    try:
        while line := text.readline(LONGEST_LINE + 1):
            number += 1
            if len(line) > LONGEST_LINE:
                raise DefinitionError(f"{name}, line {number}: longer than {LONGEST_LINE} characters: this is no table")
            if "\0" in line:
                raise DefinitionError(
                    f"{name}, line {number}: a character of code 0, so this is no text or its writing was interrupted: "
                    "leave out the lines from here on"
                )
            if line.strip():
                yield number, line.rstrip("\r\n")
    except UnicodeError:
        raise DefinitionError(
            f"cannot read the file {name}: after line {number} it is not UTF-8 text; save it as CSV in UTF-8"
        ) from None
    finally:
        text.detach()


def _form(lines: Generator[tuple[int, str], None, None], name: str) -> _Form:
    comment, head = None, None
    sample: list[str] = []
    for number, line in lines:
        if line.startswith("#"):
            comment = (number, line.lstrip("# ")) if head is None else comment
        elif head is None:
            head = (number, line)
        else:
            sample.append(line)
        if len(sample) == SAMPLE:
            break
    lines.close()
    if head is None:
        raise DefinitionError(f"{name} is empty: the first line must name the columns, such as `time,q_1,tau_1`")
    if _all_numbers(head[1]):
        # As numpy.savetxt writes it, the titles are a comment.
        if comment is None or len(_split(comment[1])) < 2:
            raise DefinitionError(
                f"{name}, line {head[0]}: numbers, but the first line must name the columns, such as `time,q_1,tau_1`"
            )
        sample, head = [head[1], *sample], comment
    separator = _separator(head[1])
    quoted = '"' in head[1] or any('"' in line for line in sample)
    plain_form = _Form(separator, False, quoted, [], head[0])
    try:
        titles = plain_form.cells(head[1])
        cells = [cell for line in sample for cell in plain_form.cells(line)]
    except csv.Error as error:
        raise DefinitionError(f"{name}: not a table: {error}") from None
    while titles and not titles[-1]:
        titles.pop()
    points = sum("." in cell and _is_number(cell) for cell in cells)
    commas = sum(_COMMA_NUMBER.fullmatch(cell) is not None for cell in cells)
    return _Form(separator, commas > 0 and points == 0, quoted, titles, head[0])


def _separator(line: str) -> str:
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "x", line)
    for separator in ("\t", ";", ","):
        if separator in bare:
            return separator
    return " " if " " in bare.strip() else ","


def _split(line: str) -> list[str]:
    return [cell for cell in re.split(r"[\s;,]+", line.strip()) if cell]


def _all_numbers(line: str) -> bool:
    return all(_is_number(cell) for cell in _split(line))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(
    lines: Iterator[tuple[int, str]], form: _Form, places: Sequence[int], name: str
) -> tuple[np.ndarray, list[str]]:
    """The numbers of the columns at these places, the first of which are the times."""
    time = places[0]
    rows, notes = _Rows(lines, form, places, name), list[str]()
    first = next(rows, None)
    if first is None:
        raise DefinitionError(f"{name} names {len(form.titles)} columns, but has no rows of numbers")
    rows.pushed = first
    stamp = _Stamp(form.titles[time])
    converters: dict[int | str, Callable[[str], float]] | None = None
    entry = first.split("\t")[0]
    if not _is_number(entry) and stamp.is_time(entry):
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

    def __init__(self, lines: Iterator[tuple[int, str]], form: _Form, places: Sequence[int], name: str) -> None:
        self._lines, self._form, self._places, self._name = lines, form, places, name
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
                    "this line, or the column if it is not needed (`--drop NAME`)"
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
                if not (_Stamp("").is_time(cell) if date else _is_number(cell)):
                    kind = "date" if date else "number"
                    return DefinitionError(
                        f"{self._name}, line {number}: `{plain(cell)}` in column `{plain(self._form.titles[place])}` "
                        f"is no {kind}; leave out this line, or correct it"
                    )
        return None


class _Stamp:
    """Dates and times of day as seconds since the first one."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._first: np.datetime64 | None = None

    def is_time(self, text: str) -> bool:
        """True if a text is a date with a time."""
        return self._moment(text) is not None

    def seconds(self, text: str) -> float:
        """Seconds since the first text.

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
