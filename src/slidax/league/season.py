"""A round of the benchmark: all schemes on all tasks, each in a process of its own and kept as soon as it has run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax._writing import write_text

from .entry import BenchmarkEntry, Form
from .match import KEPT, TaskResult, run_task
from .task import VERSION, BenchmarkTask
from .tuner import tuned

BUDGET = 48
"""Largest number of gain sets that the tuner tries for each scheme, form and task."""

Key = tuple[str, BenchmarkEntry]
"""A task's name and an entry."""
OnResult = Callable[[str, BenchmarkEntry, float], None]


@dataclass(frozen=True)
class BenchmarkRound:
    """`tasks` by name, `entries`, and the tuner's `budget`."""

    tasks: Mapping[str, BenchmarkTask]
    entries: Sequence[BenchmarkEntry]
    budget: int = BUDGET

    def small(self) -> BenchmarkRound:
        """Return a trial round: few cases, short runs and hardly any tuning, so that its numbers mean nothing."""

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
        self, out: Path | None, processes: int | None = None, on_result: OnResult = lambda *_: None
    ) -> RoundResults:
        """Run every entry on every task; results that the folder already has are read.

        - `out`: folder that keeps each result; None keeps nothing.
        - `processes`: number of parallel processes; None: one for each core; 0: this process.
        - `on_result`: called after each new result, with its seconds.
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
        # One task after another: compiled code of an arm serves the next entry on it, and takes memory.
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
        text = json.dumps([_text(task), ranges, gains.fixed], sort_keys=True)
        return {
            "version": VERSION,
            "scheme": entry.scheme,
            "form": entry.form,
            "budget": self.budget,
            "asked": hashlib.sha256(text.encode()).hexdigest()[:16],
        }

    @staticmethod
    def _path(out: Path, name: str, entry: BenchmarkEntry) -> Path:
        return out / "runs" / name / f"{entry.file}.json"


@dataclass(frozen=True)
class RoundResults:
    """Results of a `round`.

    - `by_key`: by task and entry; a message where a scheme cannot be run.
    """

    round: BenchmarkRound
    by_key: Mapping[Key, TaskResult | str]

    def on(self, task: str) -> dict[BenchmarkEntry, TaskResult]:
        """Return the results on a `task`, without schemes that cannot be run."""
        results = {entry: self.by_key.get((task, entry)) for entry in self.round.entries}
        return {entry: result for entry, result in results.items() if isinstance(result, TaskResult)}


def _text(task: BenchmarkTask) -> str:
    values = task.model_dump(mode="json", exclude={"uncertainty"}, exclude_unset=True)
    sets = {path: each.model_dump(mode="json", exclude_unset=True) for path, each in task.uncertainty.items()}
    return json.dumps({**values, "uncertainty": sets})


def _run_entry(task: str, scheme: str, form: Form, budget: int) -> TaskResult | str:
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        entry = BenchmarkEntry(scheme, form)
        return run_task(entry, BenchmarkTask.model_validate_json(task), tuned, budget, threads=1)
    except DefinitionError as error:
        return str(error)


def _write(path: Path, identity: dict[str, Any], result: TaskResult | str) -> None:
    values: dict[str, Any] = {**identity}
    if isinstance(result, str):
        values["refused"] = result
    else:
        values |= {"gains": result.gains, "cost": result.cost, "seconds": result.seconds}
        values |= {"inside": result.inside.astype(int).tolist(), "failed": result.failed.astype(int).tolist()}
        values["metrics"] = {
            name: [float(v) if np.isfinite(float(v)) else None for v in np.asarray(column, object)]
            for name, column in result.metrics.items()
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(values, allow_nan=False))


def _read(path: Path, identity: dict[str, Any]) -> TaskResult | str | None:
    """Return a kept result; None without one, or if it is of another request."""
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
