"""Cases of a study: random points of the unit cube, simulation in batches, and a table row for each case.

A family is a scenario with a set of values for each path that is uncertain or varied. A case is one scenario of the
family, with one value from each set.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from slidax.analysis.metrics import METRICS, MONITOR_METRICS, TOLERANCE_METRICS, TOOL_METRICS, metrics_of
from slidax.core.errors import DefinitionError, is_traced, nearest_word, plain_name
from slidax.law.controllers import AbstractController
from slidax.scenarios.family import Family, Templates
from slidax.scenarios.load import validate_text
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import Uncertainty
from slidax.simulation.plant import MujocoPlant
from slidax.simulation.run import Run
from slidax.simulation.simulate import Parts, simulate_batch

Columns: TypeAlias = dict[str, NDArray[Any]]
"""A table: an array for each column name, with one entry per case."""

OUTCOMES = ("ok", "left_envelope", "not_finite", "recovered")
"""Outcomes of a run; the column `outcome` has indices into this tuple."""

COLUMNS = {
    "row": "number of the case",
    "outcome": f"index in {', '.join(OUTCOMES)}",
    "t": "time of the failure, or of first leaving the envelope [s]",
    "joint": "joint of this event, from 1; if ok, the joint with the least margin",
    "margin": "least distance to the nearer bound relative to the envelope's width; negative if outside",
    **{
        metric.key: f"{metric.title}, of the worst joint [{metric.unit.format(position='rad or m', torque='N m or N')}]"
        for metric in (*METRICS, *TOOL_METRICS, *TOLERANCE_METRICS, *MONITOR_METRICS)
    },
}
"""Meanings of a table's columns, by their names."""


OF_A_RUN = ("row", "outcome", "t", "joint")
"""Columns that are no metrics."""


def require_metric(key: str, columns: Columns, where: str) -> None:
    """Raise DefinitionError, at the field `where`, unless a table has a metric or the margin with this key.

    - `columns`: a table, whose columns with a dot in their name are values of the cases.
    """
    known = [name for name in columns if name not in OF_A_RUN and "." not in name]
    if key not in known:
        raise DefinitionError(f"there is no metric `{plain_name(key)}`; {nearest_word(key, known)}", where=where)


def columns_of(run: Run) -> Columns:
    """Return outcome and metrics of each run as a table; `COLUMNS` explains its columns, and missing values are NaN.

    The column `margin` is the least envelope margin over all joints. It is negative for every run that left its
    envelope or ended early; the earlier the end, the lower the margin. Metrics are those of the worst joint.

    - `run`: a run or a batch.
    """
    single = not np.ndim(run.period)
    tally, fault = run.tally, run.fault
    kind = np.atleast_1d(np.asarray(fault.kind))
    rows = len(kind)
    outside = np.atleast_1d(np.asarray(tally.violations)) > 0
    outcome = np.where((kind == 0) & outside, OUTCOMES.index("recovered"), kind)
    margins = np.asarray(tally.margin).reshape(rows, -1)
    # The margin of a nonfinite joint is NaN; without an envelope the margin is infinite.
    least = np.where(np.isnan(margins), -np.inf, margins)
    margin = least.min(axis=1)
    ended = np.atleast_1d(np.asarray(fault.t)) / np.atleast_1d(np.asarray(run.t1))
    margin = np.where(kind > 0, np.minimum(margin, 0.0) - 1.0 + ended, margin)
    margin = np.where((outcome > 0) & (margin >= 0), -1e-12, margin)
    when = np.where(kind > 0, np.atleast_1d(np.asarray(fault.t)), np.nan)
    joint = np.where(kind > 0, np.atleast_1d(np.asarray(fault.joint)), least.argmin(axis=1)) + 1
    if run.excursion is not None:
        first = np.atleast_1d(np.asarray(run.excursion.first)) * np.atleast_1d(np.asarray(run.period))
        back = outcome == OUTCOMES.index("recovered")
        when = np.where(back, first, when)
        joint = np.where(back, np.atleast_1d(np.asarray(run.excursion.joint)) + 1, joint)
    columns: Columns = {
        "outcome": outcome.astype(np.int8),
        "t": when,
        "joint": joint.astype(np.int16),
        "margin": np.where(np.isfinite(margin), margin, np.nan),
    }
    for item in metrics_of(run):
        value: Any = item(run)
        if value is None:
            columns[item.key] = np.full(rows, np.nan)
            continue
        filled = np.ma.filled(np.ma.asarray(value, float), np.nan)
        numbers = filled.reshape(rows, -1) if not single or item.per_joint else filled.reshape(1, -1)
        worst = _worst(numbers, item.least_is_best)
        columns[item.key] = np.where(np.isfinite(worst), worst, np.nan)
    return columns


LARGER_IS_BETTER = frozenset(
    item.key for item in (*METRICS, *TOLERANCE_METRICS, *MONITOR_METRICS) if not item.least_is_best
) | {"margin"}
"""Columns of a table whose larger values are better."""


COUNTS = frozenset(item.key for item in (*METRICS, *TOLERANCE_METRICS, *MONITOR_METRICS) if item.counts)
"""Columns that count samples, and are 0 in a good run."""


def _worst(numbers: NDArray[Any], least_is_best: bool) -> NDArray[Any]:
    return numbers.max(axis=1) if least_is_best else numbers.min(axis=1)


def join_rows(parts: Sequence[tuple[NDArray[Any], Columns]], rows: int) -> Columns:
    """Merge groups of rows into one table in row order, and return it; missing values are NaN, or 0 for integers.

    - `parts`: for each group, the indices of its rows in the table, and its columns.
    - `rows`: number of rows in the table.
    """
    names = list(dict.fromkeys(name for _, columns in parts for name in columns))
    table: Columns = {}
    for name in names:
        kinds = [columns[name].dtype for _, columns in parts if name in columns]
        kind = np.result_type(*kinds)
        array = np.full(rows, np.nan, kind) if kind.kind == "f" else np.zeros(rows, kind)
        for where, columns in parts:
            if name in columns:
                array[where] = columns[name]
        table[name] = array
    return table


def concatenate(parts: Mapping[int, Columns]) -> Columns:
    """Return the table of all chunks, in the order of the rows.

    - `parts`: the chunks' columns, by the number of the chunk's first row.
    """
    ordered = [parts[first] for first in sorted(parts)]
    return {name: np.concatenate([columns[name] for columns in ordered]) for name in ordered[0]} if ordered else {}


MOST_LOOPS = 64
"""Largest number of compiled loops in a study; each value that cannot vary within a loop needs a loop of its own."""

LEAST_SIZE = 512
"""Smallest batch size for which the map from values to arrays is compiled; smaller batches are padded to it."""

Values = Mapping[str, NDArray[Any]]
"""Values of cases: an array for each dotted path of the scenario, whose first axis is the case."""


@dataclass(eq=False)
class Cases:
    """Simulates cases of a family in batches, by compiled simulation loops, which are cached.

    One loop serves all cases that differ only in values that become arrays. Each value of any other kind, such as a
    period, a delay, or a table of waypoints, needs a loop of its own. The results of a case do not depend on the other
    cases, bit for bit.

    - `family`: the family of scenarios.
    - `engine`: as in `simulate`; the scenario's own if None.
    - `threads`: threads of the native engine; None for one per core.
    - `name`: name of the scenarios.
    - `around`: maps the law of each case to the controller that is simulated in its place; None for the law itself.
    - `columns`: maps a run or a batch to its table, like `columns_of`.
    """

    family: Family
    engine: str | None = None
    threads: int | None = None
    name: str = "case"
    around: Callable[[Any], AbstractController] | None = None
    columns: Callable[[Run], Columns] = columns_of
    _loops: dict[tuple[Any, ...], _Loop | None] = field(default_factory=dict, init=False)
    _traceable: dict[str, bool] | None = field(default=None, init=False)

    def run(self, values: Values) -> Columns:
        """Simulate cases, and return a table with the outcome and metrics of each, in their order.

        - `values`: values of the cases, for every path of the family; a single case if empty.

        Raises DefinitionError if a case is invalid, or if more than 64 loops would serve several cases each.
        """
        rows = len(next(iter(values.values()))) if values else 1
        result: list[tuple[NDArray[Any], Columns]] = []
        for group, key in self._groups(values, rows):
            picked = {path: array[group] for path, array in values.items()}
            loop = self._loop(key, picked)
            if loop is None:
                columns = self._run_singly(picked, len(group))
            else:
                columns = self.columns(loop.simulated(picked, self.threads, None))
            result.append((group, columns))
        return join_rows(result, rows)

    def logged(self, values: Values) -> list[Run]:
        """Simulate cases, and return the run of each, in their order, with every sample in its log.

        - `values`: values of the cases, for every path of the family; a single case if empty.
        """
        rows = len(next(iter(values.values()))) if values else 1
        result: list[Run] = [None] * rows  # type: ignore[list-item]
        for group, key in self._groups(values, rows):
            picked = {path: array[group] for path, array in values.items()}
            loop = self._loop(key, picked)
            runs = None if loop is None else loop.simulated(picked, self.threads, 1)
            for i, row in enumerate(group):
                item = {path: array[i] for path, array in picked.items()}
                result[row] = self._scenario(item).simulate(log_every=1, progress=False) if runs is None else runs[i]
        return result

    def batch(self, values: Values, log_every: int | None = None) -> Run:
        """Simulate cases by a single compiled loop, and return them as one batched `Run`.

        - `values`: values of the cases, for every path of the family.
        - `log_every`: n to log every n-th sample; None for no log.

        Raises DefinitionError if a value that varies needs a loop of its own, such as a period, or MuJoCo simulates.
        """
        groups = self._groups(values, len(next(iter(values.values()))))
        loop = self._loop(groups[0][1], values) if len(groups) == 1 else None
        if loop is None:
            fixed = [path for path, varies in (self._traceable or {}).items() if not varies]
            raise DefinitionError(
                f"{', '.join(f'`{path}`' for path in fixed)} cannot vary within a compiled loop: simulate the "
                "scenarios one by one"
            )
        return loop.simulated(values, self.threads, log_every)

    def _groups(self, values: Values, rows: int) -> list[tuple[NDArray[Any], tuple[Any, ...]]]:
        """Group the rows by loop; return the indices of each group's rows, and the key of its loop."""
        if self._traceable is None:
            first = {path: array[0] for path, array in values.items()}
            templates = self._templates(first)
            batched = not isinstance(templates.built.plant, MujocoPlant)
            some = {path: array[:2] for path, array in values.items()}
            self._traceable = self.family.traceable(templates, some) if batched else dict.fromkeys(values, False)
        fixed = [path for path, varies in self._traceable.items() if not varies]
        if not fixed:
            return [(np.arange(rows), ())]
        flat = np.concatenate([values[path].reshape(rows, -1).astype(float) for path in fixed], axis=1)
        each, which = np.unique(flat, axis=0, return_inverse=True)
        which, keys = which.reshape(-1), [tuple(key) for key in each.tolist()]
        if len(fixed) < len(values) and len(self._loops.keys() | set(keys)) > MOST_LOOPS:
            raise DefinitionError(
                f"each value of {' and '.join(f'`{path}`' for path in fixed)} needs a loop of its own, and at most "
                f"{MOST_LOOPS} loops are compiled: use a set `choice` of few values"
            )
        return [(np.flatnonzero(which == k), key) for k, key in enumerate(keys)]

    def _loop(self, key: tuple[Any, ...], values: Values) -> _Loop | None:
        """Return the loop of a group; None if its cases run one by one."""
        if key in self._loops:
            return self._loops[key]
        templates = self._templates({path: array[0] for path, array in values.items()})
        if isinstance(templates.built.plant, MujocoPlant):
            # Each case is a scenario of its own: there is nothing to cache.
            return None
        varying = [path for path, varies in (self._traceable or {}).items() if varies]
        self._loops[key] = _Loop.of(self.family, templates, {path: values[path] for path in varying}, self.around)
        return self._loops[key]

    def _run_singly(self, values: Values, rows: int) -> Columns:
        result = []
        for row in range(rows):
            item = self._scenario({path: array[row] for path, array in values.items()})
            result.append((np.array([row]), self.columns(item.simulate(log_every=None, progress=False))))
        return join_rows(result, rows)

    def _templates(self, first: Mapping[str, Any]) -> Templates:
        built = self.family.templates(first)
        return built if self.engine is None else built.with_engine(self.engine)

    def _scenario(self, first: Mapping[str, Any]) -> Scenario:
        built = self.family.scenario(first, self.name)
        if self.around is not None:
            built = built.replace(controller=self.around(built.controller))
        return built if self.engine is None else built.replace(engine=self.engine)


@dataclass(frozen=True, eq=False)
class _Loop:
    """A compiled simulation loop, and the maps from values of cases to its arrays.

    - `scenario`: the scenario of one case.
    - `arrays`: maps values of cases to the arrays that vary between them.
    - `define`: maps the varying arrays of one case to the arguments of `simulate`.
    - `paths`: paths of the values that vary within the loop.
    """

    scenario: Scenario
    arrays: Callable[[Any], list[Any]]
    define: Callable[[Any], Parts]
    paths: tuple[str, ...]

    @classmethod
    def of(
        cls,
        family: Family,
        templates: Templates,
        values: Values,
        around: Callable[[Any], AbstractController] | None = None,
    ) -> _Loop:
        """Return the loop of a group of cases.

        - `family`: family of the cases.
        - `templates`: the parts of one case.
        - `values`: values of some cases, for each path that varies within the loop.
        - `around`: as in `Cases`.
        """
        varies: list[bool] = []

        def leaves_of(inputs: Any) -> list[Any]:
            # Arrays that do not depend on the values are computed, and checked, during the trace.
            with jax.ensure_compile_time_eval():
                arrays, _ = eqx.partition(family.parts(templates, inputs), eqx.is_array)
            return jax.tree.leaves(arrays)

        def probe(inputs: Any) -> int:
            varies[:] = [is_traced(leaf) for leaf in leaves_of(inputs)]
            return 0

        if values:
            jax.vmap(probe)({path: np.asarray(array[:1]) for path, array in values.items()})
        arrays, rest = eqx.partition(family.parts(templates, {}), eqx.is_array)
        fixed, tree = jax.tree.flatten(arrays)
        varies = varies or [False] * len(fixed)

        def define(inputs: list[Any]) -> Parts:
            result = iter(inputs)
            leaves = [next(result) if item else leaf for leaf, item in zip(fixed, varies, strict=True)]
            parts: Parts = eqx.combine(jax.tree.unflatten(tree, leaves), rest)
            return parts if around is None else (parts[0], around(parts[1]), *parts[2:])

        def varying(inputs: Any) -> list[Any]:
            return [leaf for leaf, item in zip(leaves_of(inputs), varies, strict=True) if item]

        built = templates.built if around is None else templates.built.replace(controller=around(templates.controller))
        return cls(built, jax.jit(jax.vmap(varying)), define, tuple(values))

    def simulated(self, values: Values, threads: int | None, log_every: int | None) -> Run:
        """Simulate cases, and return them as one batched `Run`.

        - `values`: values of the cases.
        - `threads`: threads of the native engine.
        - `log_every`: n to log every n-th sample; None for no log.
        """
        rows = len(next(iter(values.values()))) if values else 1
        # Use few different sizes, so that arrays are compiled rarely.
        size = max(LEAST_SIZE, 1 << max(rows - 1, 0).bit_length())
        inputs = {path: np.resize(values[path], (size, *values[path].shape[1:])) for path in self.paths}
        varied = [np.asarray(leaf)[:rows] for leaf in self.arrays(inputs)] if self.paths else []
        if not varied:
            return _repeated(self.scenario.simulate(log_every=log_every, progress=False), rows)
        item = self.scenario
        return simulate_batch(
            self.define, varied, t1=item.t1, stepping=item.stepping, log_every=log_every, threads=threads
        )


def _repeated(run: Run, rows: int) -> Run:
    """Return a batch of identical runs."""
    return jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (rows, *np.shape(x))), run)


WORDS = 4
"""64-bit numbers per step of the generator's counter."""


def points(seed: int, first: int, rows: int, dimensions: int) -> NDArray[np.float64]:
    """Return random points of the unit cube [rows, dimensions]; a point depends only on its row's number and the seed.

    Each row has a fixed position in the stream of a counter-based generator (Philox, Salmon et al. 2011).

    - `seed`: seed of the stream.
    - `first`, `rows`: number of the first row, and number of rows.
    - `dimensions`: dimension of the cube.
    """
    steps = -(-max(dimensions, 1) // WORDS)
    stream = np.random.Philox(key=seed)
    stream.advance(first * steps)
    drawn = np.random.Generator(stream).random((rows, steps * WORDS))
    return drawn[:, :dimensions]


@dataclass(frozen=True)
class StudyTask:
    """A family of scenarios as text, from which other processes can compute cases.

    - `text`: JSON with the scenario's description, its sets, and the engine.
    """

    text: str

    @classmethod
    def of(cls, family: Family, engine: str | None = None) -> StudyTask:
        """Return the task for a family; `engine` is as in `simulate`, or the scenario's own if None."""
        base = family.base.model_dump(mode="json", exclude_unset=True, exclude={"uncertainty"})
        sets = [
            {path: item.model_dump(mode="json", exclude_unset=True) for path, item in space.sets.items()}
            for space in (family.uncertain, family.varied)
        ]
        text = {"scenario": base, "uncertain": sets[0], "varied": sets[1], "engine": engine}
        return cls(json.dumps(text, sort_keys=False, ensure_ascii=False))

    @property
    def content(self) -> dict[str, Any]:
        """The text as a mapping, with the keys `scenario`, `uncertain`, `varied` and `engine`."""
        return json.loads(self.text)

    def cases(self, threads: int | None = None) -> Cases:
        """Return the `Cases` of the family, cached by text so that a process compiles once.

        - `threads`: threads of the native engine.
        """
        return _cases(self.text, threads)

    def run(self, values: Values, threads: int | None = None) -> Columns:
        """Simulate cases, also in a new process, and return a table with outcome and metrics of each.

        - `values`: values of the cases.
        - `threads`: threads of the native engine.
        """
        jax.config.update("jax_enable_x64", True)
        return self.cases(threads).run(values)


@functools.lru_cache(maxsize=8)
def _cases(text: str, threads: int | None) -> Cases:
    parts = json.loads(text)
    sets = TypeAdapter(Uncertainty)
    family = Family.of(
        validate_text(parts["scenario"]),
        sets.validate_python(parts["uncertain"]),
        sets.validate_python(parts["varied"]),
    )
    return Cases(family, parts["engine"], threads)


def flatten_values(values: Mapping[str, Any]) -> Columns:
    """Return a column for each number of the values, named by path and index, such as `robot.plant.coulomb[0]`.

    - `values`: an array for each path, whose first axis is the case.
    """
    columns: Columns = {}
    for path, array in values.items():
        inputs = np.asarray(array)
        if inputs.ndim == 1:
            columns[path] = inputs
            continue
        for index in np.ndindex(inputs.shape[1:]):
            columns[f"{path}[{','.join(map(str, index))}]"] = inputs[(slice(None), *index)]
    return columns
