"""Rounds of the benchmark: each scheme tuned and scored on each task, in parallel processes, with stored results."""

from __future__ import annotations

import hashlib
import json
import os
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.core.files import json_value
from slidax.core.writing import write_text
from slidax.scenarios.family import Family, as_changes

from ..cases import OUTCOMES, Cases, Columns, Values, points
from ..search import search_lowest
from .entries import VERSION, BenchmarkEntry, BenchmarkTask, CasesDescription, Form

ENDED = [OUTCOMES.index("left_envelope"), OUTCOMES.index("not_finite")]

KEPT = ("steady_error", "peak_torque", "max_torque_step", "steady_torque_step", "torque_energy", "tolerance_margin")
"""Metrics stored for each held-out case, of its worst joint."""

Tuner = Callable[[Callable[[NDArray[Any]], NDArray[Any]], int, int], NDArray[Any]]
"""Function of an objective on the unit cube, its dimension and a budget of points; returns the best point."""


@dataclass(frozen=True)
class TaskResult:
    """Result of a scheme on a task.

    - `gains`: tuned gains, by dotted path.
    - `cost`: mean of `costs` over the training cases, with the tuned gains.
    - `inside`: True if the held-out case never left the tolerance band [cases].
    - `failed`: True if the held-out case was lost: it ended early, or its steady error exceeds the tolerance band's
      initial radius [cases].
    - `metrics`: the metrics in `KEPT`, by name [cases].
    - `seconds`: wall-clock time for tuning and scoring [s].
    """

    gains: dict[str, Any]
    cost: float
    inside: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    metrics: dict[str, NDArray[Any]]
    seconds: float


def run_task(
    entry: BenchmarkEntry, task: BenchmarkTask, tuner: Tuner, budget: int, threads: int | None = None
) -> TaskResult:
    """Tune a scheme on a task's training cases, and score it on the held-out cases.

    - `tuner`: searches for the best gains, as points of the unit cube.
    - `budget`: largest number of gain sets that the tuner may try.
    - `threads`: threads of the native engine.

    Raises DefinitionError if the scheme does not fit the task.
    """
    started = time.perf_counter()
    with warnings.catch_warnings():
        # Warnings are useless here: some gains in the ranges suit other arms only.
        warnings.simplefilter("ignore")
        base = entry.described(task)
        family = Family.of(base, task.uncertainty, entry.gains().sets(base))
        cases = Cases(family, threads=threads, name=entry.file)
        training, scale = draw_cases(family, task.training), Scale.of(family)

        def objective(cube: NDArray[Any]) -> NDArray[Any]:
            count, each = len(cube), task.training.cases
            tried = family.varied.values(cube)
            values = {path: np.tile(array, (count, *[1] * (array.ndim - 1))) for path, array in training.items()}
            values |= {path: np.repeat(array, each, axis=0) for path, array in tried.items()}
            return costs(cases.run(values), scale).reshape(count, each).mean(axis=1)

        dimension = family.varied.dimensions
        best = np.clip(tuner(objective, dimension, budget), 0.0, np.nextafter(1.0, 0.0))
        gains = {path: array[0] for path, array in family.varied.values(best[None]).items()}
        held = draw_cases(family, task.held_out)
        fixed = {path: np.broadcast_to(array, (task.held_out.cases, *array.shape)) for path, array in gains.items()}
        columns = cases.run({**held, **fixed})
        cost = float(objective(best[None])[0])
    inside, failed = mark_inside(columns), mark_failures(columns, scale)
    kept = {name: np.asarray(columns[name], float) for name in KEPT}
    return TaskResult(as_changes(gains), cost, inside, failed, kept, time.perf_counter() - started)


def draw_cases(family: Family, cases: CasesDescription) -> Values:
    """Return the uncertain values drawn for the cases: an array for each path, whose first axis is the case."""
    space = family.uncertain
    return space.values(points(cases.seed, 0, cases.cases, space.dimensions))


@dataclass(frozen=True)
class Scale:
    """Scales of a task's errors and torques, each the largest over the joints.

    - `initial`, `final`: radii of the tolerance band [rad or m].
    - `torque`: torque limit [N m or N]; infinite without limits.
    """

    initial: float
    final: float
    torque: float

    @classmethod
    def of(cls, family: Family) -> Scale:
        """Return the scales of a task, from its family of scenarios.

        Raises DefinitionError if its scenarios have no tolerance band.
        """
        tolerance = family.base.tolerance
        if tolerance is None:
            raise DefinitionError("a task of the benchmark needs a tolerance band: set `tolerance`")
        performance: Any = tolerance.build().performance
        torque = family.base.moving().drive.limits().torque
        return cls(*(float(np.max(np.asarray(each))) for each in (performance.initial, performance.final, torque)))


def mark_inside(columns: Columns) -> NDArray[np.bool_]:
    """Return a mask of the cases that reached their end and never left the tolerance band [cases]."""
    return (columns["tolerance_violations"] == 0) & ~np.isin(columns["outcome"], ENDED)


def mark_failures(columns: Columns, scale: Scale) -> NDArray[np.bool_]:
    """Return a mask of the cases that ended early, or whose steady error exceeds the band's initial radius [cases]."""
    return np.isin(columns["outcome"], ENDED) | ~(columns["steady_error"] <= scale.initial)


def costs(columns: Columns, scale: Scale) -> NDArray[Any]:
    """Return the tuner's cost of each case.

    - Inside the tolerance band: `½ √(e/ρ∞) + ½ √(Δτ/τ_max)`, at most 1, with the worst joint's steady error e and
      steady torque step Δτ.
    - Outside: `1 + min(8, -m) + n/(n + 100)`, below 10, with the tolerance margin m and n samples outside.
    - For a run that ended early, at time t: `20 - t/(1 s + t)`.

    ρ∞ and τ_max are `scale.final` and `scale.torque`.
    """
    error = np.sqrt(np.minimum(columns["steady_error"] / scale.final, 1.0))
    step = np.sqrt(np.minimum(columns["steady_torque_step"] / scale.torque, 1.0))
    good = 0.5 * np.nan_to_num(error, nan=1.0) + 0.5 * np.nan_to_num(step, nan=1.0)
    depth = np.clip(-np.nan_to_num(columns["tolerance_margin"], nan=-8.0), 0.0, 8.0)
    outside = columns["tolerance_violations"]
    bad = 1.0 + depth + outside / (outside + 100.0)
    ended = np.isin(columns["outcome"], ENDED)
    early = 20.0 - np.nan_to_num(columns["t"] / (1.0 + columns["t"]), nan=0.0)
    return np.where(ended, early, np.where(mark_inside(columns), good, bad))


SEED = 7


def tune_gains(objective: Callable[[NDArray[Any]], NDArray[Any]], dimension: int, budget: int) -> NDArray[Any]:
    """Return the point of the unit cube with the best gains, by spread points and CMA-ES (`search_lowest`).

    - `objective`: maps points [points, dimension] to costs [points].
    - `budget`: largest number of points.
    """
    search = search_lowest(objective, dimension, evaluations=budget, seed=SEED, islands=2, keep=1)
    return search.points[0] if len(search.points) else np.full(dimension, 0.5)


MISTAKES = (ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError)
"""Errors that a mistake in a law raises."""

BUDGET = 48
"""Number of gain sets that the tuner may try for each scheme, form and task."""

Key = tuple[str, BenchmarkEntry]
"""A task's name and an entry."""
OnResult = Callable[[str, BenchmarkEntry, float], None]
"""Function of a task's name, an entry, and the time in which its result was computed [s]."""


@dataclass(frozen=True)
class BenchmarkRound:
    """A round of the benchmark, in which every entry is tuned and scored on every task.

    - `tasks`: the tasks, by name.
    - `budget`: number of gain sets that the tuner may try for each entry and task.
    """

    tasks: Mapping[str, BenchmarkTask]
    entries: Sequence[BenchmarkEntry]
    budget: int = BUDGET

    def small(self) -> BenchmarkRound:
        """Return a trial round with few cases, short runs and little tuning; its results are meaningless."""

        def short(task: BenchmarkTask) -> BenchmarkTask:
            simulation = dict(task.scenario["simulation"], t1=0.2, substeps=1)
            return task.model_copy(
                update={
                    "scenario": {**task.scenario, "simulation": simulation},
                    "training": task.training.model_copy(update={"cases": 2}),
                    "held_out": task.held_out.model_copy(update={"cases": 8}),
                }
            )

        return BenchmarkRound({name: short(task) for name, task in self.tasks.items()}, self.entries, 4)

    def run(
        self, out: str | Path | None, processes: int | None = None, on_result: OnResult = lambda *_: None
    ) -> RoundResults:
        """Tune and score every entry on every task, and return all results; stored results are read from the folder.

        - `out`: folder for the results; None stores nothing.
        - `processes`: number of parallel processes; None for one per core; 0 for this process.
        - `on_result`: called after each new result with task name, entry and computing time [s].
        """
        results: dict[Key, TaskResult | str] = {}
        left: list[Key] = []
        for name, task in self.tasks.items():
            for entry in self.entries:
                kept = None if out is None else _read(self._path(out, name, entry), self._identity(task, entry))
                if kept is None:
                    left.append((name, entry))
                else:
                    results[name, entry] = kept

        def done(key: Key, result: TaskResult | str) -> None:
            results[key] = result
            if out is not None:
                _write(self._path(out, *key), self._identity(self.tasks[key[0]], key[1]), result)
            on_result(*key, 0.0 if isinstance(result, str) else result.seconds)

        if processes == 0:
            for name, entry in left:
                done((name, entry), _run_entry(_text(self.tasks[name]), entry.scheme, entry.form, self.budget))
        elif left:
            self._in_processes(left, processes or os.cpu_count() or 1, done)
        return RoundResults(self, results)

    def _in_processes(self, left: list[Key], count: int, done: Callable[[Key, TaskResult | str], None]) -> None:
        # Task by task: entries of a task share compiled code of its arm, which takes memory.
        for task in self.tasks:
            pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
            jobs = {
                pool.submit(_run_entry, _text(self.tasks[name]), entry.scheme, entry.form, self.budget): (name, entry)
                for name, entry in left
                if name == task
            }
            try:
                for job in as_completed(jobs):
                    done(jobs[job], job.result())
            finally:
                # Also after an error or an interrupt.
                pool.shutdown(wait=False, cancel_futures=True)

    def _identity(self, task: BenchmarkTask, entry: BenchmarkEntry) -> dict[str, Any]:
        gains = entry.gains()
        ranges = {path: gain.model_dump() for path, gain in gains.tuned.items()}
        request = [_text(task), ranges, gains.fixed]
        if entry.file_of_law is not None:
            # Results of another law under the same name must not be reused.
            request.append(entry.file_of_law.read_text(encoding="utf-8"))
        text = json.dumps(request, sort_keys=True)
        return {
            "version": VERSION,
            "scheme": entry.scheme,
            "form": entry.form,
            "budget": self.budget,
            "asked": hashlib.sha256(text.encode()).hexdigest()[:16],
        }

    @staticmethod
    def _path(out: str | Path, name: str, entry: BenchmarkEntry) -> Path:
        return Path(out, "runs", name) / f"{entry.file}.json"


@dataclass(frozen=True)
class RoundResults:
    """Results of a `round`.

    - `by_key`: result by task name and entry; a text with the reason if the scheme cannot run on the task.
    """

    round: BenchmarkRound
    by_key: Mapping[Key, TaskResult | str]

    def on(self, task: str) -> dict[BenchmarkEntry, TaskResult]:
        """Return the results on a `task` by entry, without entries that cannot run on it."""
        results = {entry: self.by_key.get((task, entry)) for entry in self.round.entries}
        return {entry: result for entry, result in results.items() if isinstance(result, TaskResult)}


def _text(task: BenchmarkTask) -> str:
    values = task.model_dump(mode="json", exclude={"uncertainty"}, exclude_unset=True)
    sets = {path: each.model_dump(mode="json", exclude_unset=True) for path, each in task.uncertainty.items()}
    return json.dumps({**values, "uncertainty": sets})


def _run_entry(task: str, scheme: str, form: Form, budget: int) -> TaskResult | str:
    import jax

    jax.config.update("jax_enable_x64", True)
    entry = BenchmarkEntry(scheme, form)
    try:
        return run_task(entry, BenchmarkTask.model_validate_json(task), tune_gains, budget, threads=1)
    except DefinitionError as error:
        return str(error)
    except MISTAKES as error:
        file = entry.file_of_law
        lines = [each.lineno for each in traceback.extract_tb(error.__traceback__) if each.filename == str(file)]
        if not lines:
            raise
        # A mistake in a user's law does not end the round of all others.
        return f"{type(error).__name__} in line {lines[-1]} of {file}: {error}"


def _write(path: Path, identity: dict[str, Any], result: TaskResult | str) -> None:
    values: dict[str, Any] = {**identity}
    if isinstance(result, str):
        values["refused"] = result
    else:
        values |= {"gains": result.gains, "cost": result.cost, "seconds": result.seconds}
        values |= {"inside": result.inside.astype(int).tolist(), "failed": result.failed.astype(int).tolist()}
        values["metrics"] = json_value({name: np.asarray(item, float) for name, item in result.metrics.items()})
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(values, allow_nan=False))


def _read(path: Path, identity: dict[str, Any]) -> TaskResult | str | None:
    """Return a stored result; None if it is missing, or is for other tasks, gains or laws."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if any(values.get(key) != value for key, value in identity.items()):
        return None
    if "refused" in values:
        return str(values["refused"])
    metrics = {name: np.array(values["metrics"][name], float) for name in KEPT}
    inside, failed = (np.array(values[name], bool) for name in ("inside", "failed"))
    return TaskResult(values["gains"], values["cost"], inside, failed, metrics, values["seconds"])
