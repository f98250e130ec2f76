"""Cases of a family of scenarios: random points, simulation in batches, and a row for each case."""

from __future__ import annotations

import functools
import hashlib
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
from slidax.core.errors import DefinitionError, is_traced
from slidax.law.controllers import AbstractController
from slidax.scenarios.family import Family, Templates
from slidax.scenarios.load import validate_text
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import Uncertainty
from slidax.simulation.plant import MujocoPlant
from slidax.simulation.run import Run
from slidax.simulation.simulate import Parts, simulate_batch

Columns: TypeAlias = dict[str, NDArray[Any]]
"""Columns by name, each with one entry per case."""

OUTCOMES = ("ok", "left_envelope", "not_finite", "recovered")
"""Meanings of the numbers in the column `outcome`."""

COLUMNS = {
    "row": "number of the case",
    "outcome": f"place in {', '.join(OUTCOMES)}",
    "t": "when it ended badly or left its envelope [s]",
    "joint": "which joint did, from 1; that with the least margin in a run that is ok",
    "margin": "least distance to the nearer bound over the envelope's width; negative if it was outside",
    **{
        metric.key: f"{metric.title}, of the worst joint [{metric.unit.format(position='rad or m', torque='N m or N')}]"
        for metric in (*METRICS, *TOOL_METRICS, *TOLERANCE_METRICS, *MONITOR_METRICS)
    },
}
"""Meanings of the columns of a table."""


def columns_of(run: Run) -> Columns:
    """Outcome and metrics of each run.

    - column `outcome`: its place in `OUTCOMES`; `t`: when that was [s]; `joint`: which, counted from 1, or that with
      the least margin in a run that is ok.
    - column `margin`: least distance to the nearer bound over the envelope's width, in any joint; negative for every
      run that was outside, the lower the earlier it ended.
    - all metrics of `slidax.analysis` by their keys, of the worst joint.

    Missing values are NaN.

    - `run`: many runs, or one.
    """
    single = not np.ndim(run.period)
    tally, fault = run.tally, run.fault
    kind = np.atleast_1d(np.asarray(fault.kind))
    rows = len(kind)
    outside = np.atleast_1d(np.asarray(tally.violations)) > 0
    outcome = np.where((kind == 0) & outside, OUTCOMES.index("recovered"), kind)
    margins = np.asarray(tally.margin).reshape(rows, -1)
    # A joint that is not finite has no margin, and one without an envelope an infinite one.
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


def _worst(numbers: NDArray[Any], least_is_best: bool) -> NDArray[Any]:
    return numbers.max(axis=1) if least_is_best else numbers.min(axis=1)


def join_rows(parts: Sequence[tuple[NDArray[Any], Columns]], rows: int) -> Columns:
    """Columns of groups of rows as one table in the order of the rows.

    - `parts`: each with the numbers of its rows.
    - `rows`: how many there are.
    """
    names = list(dict.fromkeys(name for _, columns in parts for name in columns))
    whole: Columns = {}
    for name in names:
        kinds = [columns[name].dtype for _, columns in parts if name in columns]
        kind = np.result_type(*kinds)
        array = np.full(rows, np.nan, kind) if kind.kind == "f" else np.zeros(rows, kind)
        for where, columns in parts:
            if name in columns:
                array[where] = columns[name]
        whole[name] = array
    return whole


def concatenate(parts: Mapping[int, Columns]) -> Columns:
    """Chunks of rows as one table in the order of the rows.

    - `parts`: by the number of their first row.
    """
    ordered = [parts[first] for first in sorted(parts)]
    return {name: np.concatenate([columns[name] for columns in ordered]) for name in ordered[0]} if ordered else {}


MOST_LOOPS = 64
"""That are compiled for one study, each for other values of what cannot vary within a compiled loop."""

LEAST_SIZE = 512
"""Rows that the arrays of a loop are made for at least, so that for few rows they are compiled once."""

Values = Mapping[str, NDArray[Any]]
"""Values by path, each with the case as its first axis."""


@dataclass(eq=False)
class Cases:
    """Runs cases of a family through compiled loops, which it keeps.

    Values that become arrays vary within a loop; all others, such as a period, a delay, or a table of waypoints,
    makes a loop of its own for each of its values. The bits of a case depend on no other case.

    - `family`: of which they are.
    - `engine`: as in `simulate`; the scenario's own if None.
    - `threads`: of the native engine; None: as many as there are cores.
    - `name`: what to call a scenario.
    - `around`: from the law of each case to what is run in its place.
    - `columns`: from runs to their rows.
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
        """The outcome and the metrics of cases, one row each.

        - `values`: by path, of every path of the family.

        Raises DefinitionError if a case is invalid, or they need too many loops.
        """
        rows = len(next(iter(values.values()))) if values else 1
        result: list[tuple[NDArray[Any], Columns]] = []
        for rows_of_one, key in self._groups(values, rows):
            picked = {path: array[rows_of_one] for path, array in values.items()}
            loop = self._loop(key, picked)
            if loop is None:
                columns = self._each(picked, len(rows_of_one))
            else:
                columns = self.columns(loop.simulated(picked, self.threads, None))
            result.append((rows_of_one, columns))
        return join_rows(result, rows)

    def logged(self, values: Values) -> list[Run]:
        """The runs of cases with every sample in their logs.

        - `values`: by path, of every path of the family; one case if there is none.
        """
        rows = len(next(iter(values.values()))) if values else 1
        result: list[Run] = [None] * rows  # type: ignore[list-item]
        for rows_of_one, key in self._groups(values, rows):
            picked = {path: array[rows_of_one] for path, array in values.items()}
            loop = self._loop(key, picked)
            runs = None if loop is None else loop.simulated(picked, self.threads, 1)
            for i, row in enumerate(rows_of_one):
                item = {path: array[i] for path, array in picked.items()}
                result[row] = self._scenario(item).simulate(log_every=1, progress=False) if runs is None else runs[i]
        return result

    def _groups(self, values: Values, rows: int) -> list[tuple[NDArray[Any], tuple[Any, ...]]]:
        """The rows of each loop."""
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
                f"{MOST_LOOPS} are compiled: use `choice` with few values"
            )
        return [(np.flatnonzero(which == k), key) for k, key in enumerate(keys)]

    def _loop(self, key: tuple[Any, ...], values: Values) -> _Loop | None:
        """The loop of a group; None if its cases are run one at a time."""
        if key in self._loops:
            return self._loops[key]
        templates = self._templates({path: array[0] for path, array in values.items()})
        if isinstance(templates.built.plant, MujocoPlant):
            # Each is a scenario of its own, so that there is nothing to keep.
            return None
        varying = [path for path, varies in (self._traceable or {}).items() if varies]
        self._loops[key] = _Loop.of(self.family, templates, {path: values[path] for path in varying}, self.around)
        return self._loops[key]

    def _each(self, values: Values, rows: int) -> Columns:
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
    """One compiled loop, and how its arrays follow from values.

    - `scenario`: a case of it.
    - `arrays`: from values to the arrays that vary.
    - `define`: from these to the parts of a loop.
    - `paths`: of the values.
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
        """The loop of a group.

        - `family`: of the cases.
        - `templates`: one of them.
        - `values`: some of each path that varies.
        - `around`: from the law to what is run in its place.
        """
        varies: list[bool] = []

        def leaves_of(inputs: Any) -> list[Any]:
            # Arrays that do not depend on the values are known, and checked, during the trace.
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
        """The runs.

        - `values`: by path.
        - `threads`: of the native engine.
        - `log_every`: one in so many samples; None logs none.
        """
        rows = len(next(iter(values.values()))) if values else 1
        # A few sizes, so that little is compiled anew.
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
    """One run as many that are alike."""
    return jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), (rows, *np.shape(x))), run)


WORDS = 4
"""64-bit numbers that one step of the generator's counter gives."""


def points(seed: int, first: int, rows: int, dimensions: int) -> NDArray[np.float64]:
    """Uniform points [rows, dimensions], independent of how many others are drawn with them.

    They are read off one stream (Philox, Salmon et al. 2011), in which each row has its own place.

    - `seed`: of the stream.
    - `first`: number of the first row.
    - `rows`: how many.
    - `dimensions`: of the cube.
    """
    steps = -(-max(dimensions, 1) // WORDS)
    stream = np.random.Philox(key=seed)
    stream.advance(first * steps)
    drawn = np.random.Generator(stream).random((rows, steps * WORDS))
    return drawn[:, :dimensions]


@dataclass(frozen=True)
class StudyTask:
    """A family of scenarios as text.

    - `text`: JSON with the scenario's description, its sets, and the engine.
    """

    text: str

    @classmethod
    def of(cls, family: Family, engine: str | None = None) -> StudyTask:
        """The task of a family; `engine` as in `simulate`, the scenario's own if None."""
        base = family.base.model_dump(mode="json", exclude_unset=True, exclude={"uncertainty"})
        sets = [
            {path: item.model_dump(mode="json", exclude_unset=True) for path, item in space.sets.items()}
            for space in (family.uncertain, family.varied)
        ]
        text = {"scenario": base, "uncertain": sets[0], "varied": sets[1], "engine": engine}
        return cls(json.dumps(text, sort_keys=False, ensure_ascii=False))

    @property
    def content(self) -> dict[str, Any]:
        """Values in the text."""
        return json.loads(self.text)

    @property
    def digest(self) -> str:
        """Hash of all that the rows depend on, except their values."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]

    def cases(self, threads: int | None = None) -> Cases:
        """Return the cases; the same object for the same text, so that a process compiles once.

        - `threads`: of the native engine.
        """
        return _cases(self.text, threads)

    def run(self, values: Values, threads: int | None = None) -> Columns:
        """Outcome and metrics of cases, wherever this is called.

        - `values`: by path, with the case first.
        - `threads`: of the native engine.
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
    """Values as columns, one for each number: `robot.plant.coulomb[0]`.

    - `values`: by path, with the case first.
    """
    columns: Columns = {}
    for path, array in values.items():
        inputs = np.asarray(array)
        if inputs.ndim == 1:
            columns[path] = inputs
            continue
        for place in np.ndindex(inputs.shape[1:]):
            columns[f"{path}[{','.join(map(str, place))}]"] = inputs[(slice(None), *place)]
    return columns
