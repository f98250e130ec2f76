"""Read tables of numbers from text: lines, separators, decimal signs and titles."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

from .errors import DefinitionError, count_noun, plain_name

LONGEST_LINE = 10**6
"""Characters."""

SAMPLE = 100
"""Lines from which the decimal sign is recognised."""

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}

_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?|[-+]?\d+,(?:[eE][-+]?\d+)?")

Lines = Generator[tuple[int, str], None, None]
"""Lines with their numbers."""


@dataclass(frozen=True)
class TableFormat:
    """The form of a table.

    - `separator`: of its columns; " " for any white space.
    - `comma`: True if decimals follow a comma.
    - `titles`: of its columns.
    - `header`: number of the line with the titles.
    """

    separator: str
    comma: bool
    titles: list[str]
    header: int


def lines_of(file: BinaryIO, name: str) -> Lines:
    """Yield the lines of a table from its start, without those that are empty or have only separators.

    - `file`: the table.
    - `name`: of the file, for messages.

    Raises DefinitionError if there is something that is no text.
    """
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
            if line.strip(" \t\r\n,;"):
                yield number, line.rstrip("\r\n")
    except UnicodeError:
        raise DefinitionError(
            f"cannot read the file {name}: after line {number} it is not UTF-8 text; save it as CSV in UTF-8"
        ) from None
    finally:
        # A closed file has nothing to keep open. It is closed already if both are collected in one circle.
        if not file.closed:
            text.detach()


def table_format(lines: Lines, name: str, example: str) -> TableFormat:
    """Return the form of a table, recognised from its first lines.

    - `lines`: from its start.
    - `name`: of the file, for messages.
    - `example`: of the line with the titles, for messages.

    Raises DefinitionError if there are no titles.
    """
    comment: tuple[int, str] | None = None
    head: tuple[int, str] | None = None
    sample: list[tuple[int, str]] = []
    for number, line in lines:
        if _is_comment(line):
            comment = (number, line.lstrip("# \t")) if head is None else comment
        elif head is None:
            head = (number, line)
        else:
            sample.append((number, line))
        if len(sample) == SAMPLE:
            break
    lines.close()
    if head is None:
        raise DefinitionError(f"{name} is empty: the first line must name the columns, such as `{example}`")
    if _all_numbers(head[1]):
        # As numpy.savetxt writes it, the titles are a comment.
        if comment is None or len(_split(comment[1])) < 2:
            raise DefinitionError(
                f"{name}, line {head[0]}: numbers, but the first line must name the columns, such as `{example}`"
            )
        sample, head = [head, *sample], comment
    separator = _separator(head[1])
    titles = _cells(*head, separator, name)
    while titles and not titles[-1]:
        titles.pop()
    cells = [cell for number, line in sample for cell in _cells(number, line, separator, name)]
    points = any("." in cell and is_number(cell) for cell in cells)
    commas = any(_COMMA_NUMBER.fullmatch(cell) for cell in cells)
    return TableFormat(separator, commas and not points, titles, head[0])


def rows_of(lines: Lines, form: TableFormat, places: Sequence[int], name: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line below the titles with its entries in some columns, with decimal points.

    - `lines`: from the start of the table.
    - `form`: of the table.
    - `places`: numbers of the columns from 0.
    - `name`: of the file, for messages.

    Raises DefinitionError if a line has another number of entries than there are titles, or a decimal point where
    others have commas.
    """
    count = len(form.titles)
    for number, line in lines:
        if number <= form.header or _is_comment(line):
            continue
        entries = _cells(number, line, form.separator, name)
        if len(entries) != count and (len(entries) < count or any(entries[count:])):
            raise DefinitionError(f"{name}, line {number}: {_wrong_count(len(entries), form)}")
        cells = [entries[place] for place in places]
        if form.comma:
            for place, cell in zip(places, cells, strict=True):
                if "." in cell and is_number(cell):
                    raise DefinitionError(
                        f"{name}, line {number}, column `{plain_name(form.titles[place])}`: `{plain_name(cell)}` "
                        "has a point, "
                        "where the lines above have decimal commas: leave out points between thousands, or write all "
                        "decimals alike"
                    )
            cells = [cell.replace(",", ".") for cell in cells]
        yield number, cells


def is_number(cell: str) -> bool:
    """Return True if an entry is a number, infinite and missing ones included.

    - `cell`: the entry.
    """
    try:
        float(cell)
    except ValueError:
        return False
    # Python reads `1_5` as 15, and digits of every script.
    return "_" not in cell and cell.isascii()


def _cells(number: int, line: str, separator: str, name: str) -> list[str]:
    """The entries of a line."""
    if separator == " ":
        line = " ".join(line.split())
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        row = next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except csv.Error as error:
        why = "a quotation mark is not closed" if "unexpected end" in str(error) else error
        raise DefinitionError(f"{name}, line {number}: {why}") from None
    return [cell.strip() for cell in row]


def _wrong_count(count: int, form: TableFormat) -> str:
    titles = len(form.titles)
    if count < titles:
        hint = "leave out this line if its writing was interrupted"
    elif form.separator == ",":
        hint = "if a comma stands before the decimals, separate the columns by semicolons"
    else:
        hint = f"columns are separated by {SEPARATORS[form.separator]}"
    return (
        f"{count_noun(count, 'entry', 'entries')}, but line {form.header} names {count_noun(titles, 'column')}; {hint}"
    )


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _separator(line: str) -> str:
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]|\([^)]*\)', "x", line)
    for separator in ("\t", ";", ","):
        if separator in bare:
            return separator
    return " " if " " in bare.strip() else ","


def _split(line: str) -> list[str]:
    return [cell for cell in re.split(r"[\s;,]+", line.strip()) if cell]


def _all_numbers(line: str) -> bool:
    return all(is_number(cell) for cell in _split(line))
