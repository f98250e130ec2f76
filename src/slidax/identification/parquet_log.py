"""A log from a Parquet file, by the types of its columns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError, plain
from slidax.simulation import parquet

from .columns import Columns
from .conventions import TIME_UNITS
from .log import Log
from .matching import match_columns
from .reading import Reading


def read_parquet(path: Path, joints: Sequence[str], reading: Reading) -> Log:
    """Return the log in a Parquet file, as `slidax run --out` or another tool has written it.

    Timestamps are converted by the unit of their type, and decimals and dictionaries of numbers to numbers. A list of
    numbers is a column for each of them, such as `position[0]`, or `position.elbow` where a column `name` has a list of
    the joints' names, as messages have.

    - `path`: of the file.
    - `joints`: the arm's joints, in its order.
    - `reading`: what the titles do not say.

    Raises DefinitionError, with the column, if one has another type or misses a value.
    """
    name = f"`{path.name}`"
    order = _joint_names(path, name)
    columns: list[Columns] = []
    lists: dict[str, tuple[str, int]] = {}

    def choose(schema: Any, sizes: dict[str, int]) -> list[str]:
        titles: list[str] = []
        for title in schema.names:
            if title in sizes:
                named = len(order) == sizes[title]
                parts = [f"{title}.{order[k]}" if named else f"{title}[{k}]" for k in range(sizes[title])]
                lists.update({part: (title, place) for place, part in enumerate(parts)})
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
        whole, place = lists.get(title, (title, None))
        column = table.column(whole)
        if place is not None:
            column = parquet.element(column, place)
        values[title], note = _parquet_numbers(column, title, name, is_time=title == chosen.time)
        notes += [note] if note else []
        if note and title == chosen.time:
            # The type says the unit, and the title says it again or nothing.
            values[title] = values[title] / chosen.scale[title]
    return chosen.log(name, joints, values, notes)


def _joint_names(path: Path, source: str) -> tuple[str, ...]:
    """Return the names in the lists of a column `name`; none if there is no such column."""
    title, orders = parquet.read_text_lists(path, ("name", "joint_names"))
    if len(orders) > 1:
        raise DefinitionError(
            f"{source}: the names in column `{plain(title)}` differ from row to row: write a column "
            "for each joint, such as `elbow.position`"
        )
    return next(iter(orders), ())


def _parquet_numbers(column: Any, title: str, name: str, *, is_time: bool) -> tuple[np.ndarray, str]:
    """A column as numbers, times as seconds from the first; and what was converted."""
    import pyarrow as pa
    import pyarrow.compute as pc

    where = f"{name}: column `{plain(title)}`"
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
        return seconds, f"the times in `{plain(title)}` are {kind}: they are counted from the first one"
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        numbers = column.to_numpy()
        if is_time and pa.types.is_integer(kind) and len(numbers) and abs(int(numbers[0])) > 2**53:
            # As integers, since floating-point numbers of this size have steps of hundreds.
            numbers = numbers.astype(np.int64) - np.int64(numbers[0])
        return numbers.astype(float), ""
    if pa.types.is_decimal(kind):
        return column.cast(pa.float64()).to_numpy(), ""
    raise DefinitionError(f"{where} has the type {kind}, and is no numbers: write it as float64")
