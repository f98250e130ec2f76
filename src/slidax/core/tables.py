"""Read tables of numbers from text: lines, separators, decimal signs and column titles."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import BinaryIO

from .errors import DefinitionError, count_noun, plain_name

LONGEST_LINE = 10**6
"""Most characters in a line."""

SAMPLE = 100
"""Number of lines below the titles from which the decimal sign is recognised."""

SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}

_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?|[-+]?\d+,(?:[eE][-+]?\d+)?")

Lines = Generator[tuple[int, str], None, None]
"""Lines with their numbers."""


@dataclass(frozen=True)
class TableFormat:
    """The format of a table in a text file.

    - `separator`: column separator; " " for any white space.
    - `comma`: True if the decimal sign is a comma.
    - `titles`: column titles.
    - `header`: number of the line with the titles.
    """

    separator: str
    comma: bool
    titles: list[str]
    header: int


def lines_of(file: BinaryIO, name: str) -> Lines:
    """Yield pairs (line number, line) of a table; skip lines that are empty or have only separators.

    - `file`: the table; it is read from its start.
    - `name`: file name, for messages.

    Raises DefinitionError if a line is not text or too long.
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
                raise DefinitionError(
                    f"{name}, line {number}: longer than {LONGEST_LINE} characters, so this is not a table"
                )
            if "\0" in line:
                raise DefinitionError(
                    f"{name}, line {number}: null character: the file is not text, or writing it was interrupted; "
                    "delete the lines from here on"
                )
            if line.strip(" \t\r\n,;"):
                yield number, line.rstrip("\r\n")
    except UnicodeError:
        raise DefinitionError(
            f"cannot read the file {name}: after line {number} it is not UTF-8 text; save it as CSV in UTF-8"
        ) from None
    finally:
        # Keep the file open without its wrapper. If both are garbage, Python may already have closed it.
        if not file.closed:
            text.detach()


def table_format(lines: Lines, name: str, example: str) -> TableFormat:
    """Detect the format of a table from its first lines.

    - `lines`: lines from the start of the table.
    - `name`: file name, for messages.
    - `example`: an example of the line with the titles, for messages.

    Raises DefinitionError if the table is empty or has no titles, or a line has unbalanced quotation marks.
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
        # numpy.savetxt writes the titles as a comment.
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


def rows_of(lines: Lines, form: TableFormat, columns: Sequence[int], name: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line below the titles, and its entries in the chosen columns, as text.

    Decimal commas become points.

    - `lines`: lines from the start of the table.
    - `form`: format of the table.
    - `columns`: indices of the chosen columns, from 0.
    - `name`: file name, for messages.

    Raises DefinitionError if the number of entries in a line differs from the number of titles, if a table with decimal
    commas has a decimal point, or if a line has unbalanced quotation marks.
    """
    count = len(form.titles)
    for number, line in lines:
        if number <= form.header or _is_comment(line):
            continue
        entries = _cells(number, line, form.separator, name)
        if len(entries) != count and (len(entries) < count or any(entries[count:])):
            raise DefinitionError(f"{name}, line {number}: {_wrong_count(len(entries), form)}")
        cells = [entries[column] for column in columns]
        if form.comma:
            for column, cell in zip(columns, cells, strict=True):
                if "." in cell and is_number(cell):
                    raise DefinitionError(
                        f"{name}, line {number}, column `{plain_name(form.titles[column])}`: `{plain_name(cell)}` has "
                        "a point, but the lines above have decimal commas: remove points between thousands, or use one "
                        "decimal sign in the whole file"
                    )
            cells = [cell.replace(",", ".") for cell in cells]
        yield number, cells


def is_number(cell: str) -> bool:
    """True if a table entry, as text, is a number; infinity and NaN count as numbers."""
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
        hint = "delete this line if writing it was interrupted"
    elif form.separator == ",":
        hint = "if the decimal sign is a comma, separate the columns by semicolons"
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
