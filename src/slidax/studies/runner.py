"""Computation of a study's rows, one per case, in chunks: by this process or a cluster, or read from the store."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, plain_name
from slidax.scenarios.family import Family

from .cases import Columns, StudyTask, Values, flatten_values
from .store import Store

SAMPLES = 4_000_000
"""Approximate number of samples per chunk: a few seconds of computation, so that an interruption loses little."""

LEAST, MOST = 64, 8192
"""Smallest and largest number of rows in a chunk."""


def ignore_progress(rows: int) -> None:
    """Do nothing: the progress is not shown."""


class AbstractPool(ABC):
    """Base of the pools, which compute the rows of a study in chunks."""

    @abstractmethod
    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        """Yield first row number, values and results of each chunk, in the order of completion.

        - `task`: family of scenarios to which the rows belong.
        - `chunks`: for each chunk, the number of its first row, and the values of its rows.
        """


class LocalPool(AbstractPool):
    """Computes chunks in this process, in order.

    - `threads`: threads of the native engine; None for one per core.
    """

    def __init__(self, threads: int | None = None) -> None:
        self.threads = threads

    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        for first, values in chunks:
            yield first, values, task.run(values, self.threads)


@dataclass(frozen=True)
class Part:
    """Every n-th chunk of a study, for n processes that compute the study together.

    - `number`: number of the part, from 1 to n.
    - `of`: number of parts, n.
    """

    number: int
    of: int

    @classmethod
    def parsed(cls, text: str) -> Part:
        """Return the part that a text describes, such as `2/4`.

        - `text`: number of the part, and number of parts.

        Raises DefinitionError if the text has another form.
        """
        number, _, count = text.partition("/")
        digits = all(word.isascii() and word.isdigit() and len(word) <= 6 for word in (number, count))
        if not digits or not 1 <= int(number) <= int(count):
            raise DefinitionError(f"`--part` must be a number and a count, such as 2/4; got `{plain_name(text)}`")
        return cls(int(number), int(count))

    def has(self, chunk: int) -> bool:
        """True if a chunk belongs to this part.

        - `chunk`: index of the chunk, from 0.
        """
        return chunk % self.of == self.number - 1


class PartDone(Exception):
    """This part of a study is computed, but rows of other parts are missing.

    - `missing`: number of missing rows.
    - `total`: number of rows of the study.
    """

    def __init__(self, missing: int, total: int) -> None:
        super().__init__(f"{missing} of {total} rows are missing")
        self.missing = missing
        self.total = total


@dataclass
class Runner:
    """Simulates cases and returns their rows, or reads the rows from the store.

    - `task`: family of scenarios to which the rows belong.
    - `chunk`: number of rows that are computed and stored together.
    - `store`: keeps the rows on disk; None for memory only.
    - `pool`: computes the rows.
    - `progress`: called with the number of new rows after each chunk.
    - `part`: the chunks to compute here; None for all.
    - `computed`, `seconds`: number of rows computed so far, and their computing time.
    """

    task: StudyTask
    chunk: int
    store: Store | None = None
    pool: AbstractPool = field(default_factory=LocalPool)
    progress: Callable[[int], None] = ignore_progress
    part: Part | None = None
    computed: int = 0
    seconds: float = 0.0

    @staticmethod
    def rows_of_chunk(samples: int) -> int:
        """Number of rows per chunk, a power of two.

        - `samples`: number of samples in a run.
        """
        return int(np.clip(2 ** round(np.log2(max(SAMPLES / max(samples, 1), 1.0))), LEAST, MOST))

    def rows(self, first: int, values: Values) -> Columns:
        """Return a table with a row for each case: row number, values, outcome and metrics.

        - `first`: number of the first row.
        - `values`: values of the cases.

        Raises DefinitionError and PartDone as `stream` does.
        """
        total = len(next(iter(values.values())))
        chunks = [
            (first + k, {path: array[k : k + self.chunk] for path, array in values.items()})
            for k in range(0, total, self.chunk)
        ]
        result: dict[int, Columns] = {}
        for start, columns in self.stream(iter(chunks)):
            result[start] = columns
        ordered = [result[start] for start, _ in chunks]
        return {name: np.concatenate([columns[name] for columns in ordered]) for name in ordered[0]}

    def stream(self, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Columns]]:
        """Yield first row number and table of each chunk as it becomes ready, from the store or computed.

        - `chunks`: for each chunk, the number of its first row, and the values of its rows.

        Raises DefinitionError if the store has these rows with different values, and PartDone if only a part is
        computed here and rows of other parts are missing.
        """
        if self.part is None or self.store is None:
            yield from self._stream(chunks)
        else:
            yield from self._stream_part(self.part, self.store, list(chunks))

    def _stream_part(self, part: Part, store: Store, chunks: list[tuple[int, Values]]) -> Iterator[tuple[int, Columns]]:
        done = dict(self._stream(chunk for chunk in chunks if part.has(chunk[0] // self.chunk)))
        sizes = {first: len(next(iter(values.values()))) for first, values in chunks}
        for first, values in chunks:
            columns = None if first in done else store.read(first, sizes[first])
            if columns is not None:
                _require_same(first, flatten_values(values), columns)
                self.progress(sizes[first])
                done[first] = columns
        missing = sum(size for first, size in sizes.items() if first not in done)
        if missing:
            raise PartDone(missing, sum(sizes.values()))
        yield from ((first, done[first]) for first in sizes)

    def _stream(self, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Columns]]:
        stored: list[tuple[int, Columns]] = []

        def missing() -> Iterator[tuple[int, Values]]:
            for first, values in chunks:
                known = None if self.store is None else self.store.read(first, len(next(iter(values.values()))))
                if known is None:
                    yield first, values
                    continue
                _require_same(first, flatten_values(values), known)
                stored.append((first, known))

        started = time.perf_counter() - self.seconds
        for first, values, outcome in self.pool.each(self.task, missing()):
            columns = {"row": np.arange(first, first + len(outcome["outcome"])), **flatten_values(values), **outcome}
            if self.store is not None:
                self.store.write(first, columns)
            self.computed += len(columns["row"])
            self.seconds = time.perf_counter() - started
            yield from self._drain(stored)
            self.progress(len(columns["row"]))
            yield first, columns
        yield from self._drain(stored)

    def _drain(self, stored: list[tuple[int, Columns]]) -> Iterator[tuple[int, Columns]]:
        while stored:
            first, columns = stored.pop(0)
            self.progress(len(columns["row"]))
            yield first, columns


def _require_same(first: int, values: Columns, stored: Columns) -> None:
    for name, array in values.items():
        if name not in stored or not np.array_equal(stored[name], array):
            raise DefinitionError(
                f"the rows from {first} on are stored with other values of `{name}`: they belong to another study; "
                "write to another folder"
            )


BELOW_ONE = np.nextafter(1.0, 0.0)
"""Largest coordinate of a point in the half-open unit cube."""


class BatchEvaluator:
    """Simulates cases, such as points of the unit cube, and keeps their rows, numbered in the order of evaluation.

    - `runner`: computes the rows.
    - `family`: family of scenarios, whose space maps points of the unit cube to values.
    """

    def __init__(self, runner: Runner, family: Family) -> None:
        self.runner = runner
        self.family = family
        self.rows = 0
        self._parts: list[Columns] = []
        self._values: list[Values] = []

    def points(self, cube: np.ndarray) -> Columns:
        """Simulate the cases at points of the unit cube [rows, dimensions], and return their rows as a table."""
        return self.values(self.family.space.values(np.clip(cube, 0.0, BELOW_ONE)))

    def values(self, values: Mapping[str, Any]) -> Columns:
        """Simulate cases, and return their rows as a table.

        - `values`: an array for each dotted path of the family, whose first axis is the row.
        """
        columns = self.runner.rows(self.rows, values)
        self.rows += len(columns["row"])
        self._parts.append(columns)
        self._values.append(values)
        return columns

    @property
    def table(self) -> Columns:
        """All rows, in the order of evaluation."""
        return {name: np.concatenate([part[name] for part in self._parts]) for name in self._parts[0]}

    def values_of(self, row: int) -> dict[str, Any]:
        """Return the values of a row, by dotted path of the family."""
        for values in self._values:
            rows = len(next(iter(values.values())))
            if row < rows:
                return {path: array[row] for path, array in values.items()}
            row -= rows
        raise IndexError(row)

    def collected(self) -> dict[str, Any]:
        """Write `rows.parquet` if there is a store, and return the fields of `AbstractTableResult` except `study`."""
        store = self.runner.store
        return {
            "family": self.family,
            "table": self.table,
            "path": None if store is None else store.finish(self.rows),
            "computed": self.runner.computed,
            "seconds": self.runner.seconds,
        }
