"""The form of a text table: its lines, separator, decimal sign and titles."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Generator
from dataclasses import dataclass
from typing import BinaryIO

from slidax._errors import DefinitionError

LONGEST_LINE = 10**6
"""Characters."""

SAMPLE = 100
"""Lines from which the separator and the decimal sign are recognised."""

_COMMA_NUMBER = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?|[-+]?\d+,(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class Form:
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
        """Return the entries of a line.

        - `line`: without its end.
        """
        if self.separator == " ":
            return line.split() if not self.quoted else next(csv.reader([" ".join(line.split())], delimiter=" "))
        if not self.quoted:
            return [cell.strip() for cell in line.split(self.separator)]
        return [cell.strip() for cell in next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))]

    def number(self, cell: str) -> str:
        """Return an entry with a decimal point.

        - `cell`: the entry.
        """
        return cell.replace(",", ".") if self.comma else cell


def lines_of(file: BinaryIO, name: str) -> Generator[tuple[int, str], None, None]:
    """Yield the lines that are not empty, with their numbers, from the start of the file.

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
            if line.strip():
                yield number, line.rstrip("\r\n")
    except UnicodeError:
        raise DefinitionError(
            f"cannot read the file {name}: after line {number} it is not UTF-8 text; save it as CSV in UTF-8"
        ) from None
    finally:
        text.detach()


def form_of(lines: Generator[tuple[int, str], None, None], name: str) -> Form:
    """Return the form of a table, recognised from its first lines.

    - `lines`: from its start.
    - `name`: of the file, for messages.

    Raises DefinitionError if there are no titles.
    """
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
    plain_form = Form(separator, False, quoted, [], head[0])
    try:
        titles = plain_form.cells(head[1])
        cells = [cell for line in sample for cell in plain_form.cells(line)]
    except csv.Error as error:
        raise DefinitionError(f"{name}: not a table: {error}") from None
    while titles and not titles[-1]:
        titles.pop()
    points = sum("." in cell and is_number(cell) for cell in cells)
    commas = sum(_COMMA_NUMBER.fullmatch(cell) is not None for cell in cells)
    return Form(separator, commas > 0 and points == 0, quoted, titles, head[0])


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


def is_number(cell: str) -> bool:
    """Return True if an entry is a number, infinite and missing ones included.

    - `cell`: the entry.
    """
    try:
        float(cell)
    except ValueError:
        return False
    return True
