"""All schemes on all tasks, each match in a process of its own, and kept as soon as it is played."""

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

from .entry import Entry, Form
from .match import KEPT, Match, played
from .task import VERSION, LeagueTask
from .tuner import tuned

BUDGET = 48
"""How many sets of gains the tuner may try for each scheme, form and task."""

Seen = Callable[[str, Entry, float], None]


@dataclass(frozen=True)
class Season:
    """Who plays what.

    - `tasks`: by name.
    - `entries`: schemes in their forms.
    - `budget`: of the tuner.
    """

    tasks: Mapping[str, LeagueTask]
    entries: Sequence[Entry]
    budget: int = BUDGET

    def small(self) -> Season:
        """The same with few cases, short runs and hardly any tuning: that all of it works, and nothing more."""

        def short(task: LeagueTask) -> LeagueTask:
            simulation = dict(task.scenario["simulation"], t1=0.2, substeps=1)
            return task.model_copy(
                update={
                    "scenario": {**task.scenario, "simulation": simulation},
                    "training": task.training.model_copy(update={"cases": 2}),
                    "held_out": task.held_out.model_copy(update={"cases": 8}),
                }
            )

        return Season({name: short(task) for name, task in self.tasks.items()}, self.entries, 4)

    def played(self, out: Path | None, processes: int | None = None, seen: Seen = lambda *_: None) -> Results:
        """The matches of all, those that are in the folder as they are.

        - `out`: folder in which each is kept; None keeps nothing.
        - `processes`: how many at once; as many as there are cores if None; 0: this one.
        - `seen`: told of each match that has been played, with its seconds.
        """
        found: dict[tuple[str, Entry], Match | str] = {}
        left: list[tuple[str, Entry]] = []
        for name, task in self.tasks.items():
            for entry in self.entries:
                kept = None if out is None else _kept(self._path(out, name, entry), self._identity(task, entry))
                if kept is None:
                    left.append((name, entry))
                else:
                    found[name, entry] = kept

        def done(which: tuple[str, Entry], match: Match | str) -> None:
            found[which] = match
            if out is not None:
                _keep(self._path(out, *which), self._identity(self.tasks[which[0]], which[1]), match)
            seen(*which, 0.0 if isinstance(match, str) else match.seconds)

        if processes == 0:
            for name, entry in left:
                done((name, entry), _match(_text(self.tasks[name]), entry.scheme, entry.form, self.budget))
        elif left:
            self._in_processes(left, processes or os.cpu_count() or 1, done)
        return Results(self, found)

    def _in_processes(
        self, left: list[tuple[str, Entry]], count: int, done: Callable[[tuple[str, Entry], Match | str], None]
    ) -> None:
        # A task after the other: what was compiled for an arm serves the next match on it, and takes memory.
        for task in self.tasks:
            pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
            jobs = {
                pool.submit(_match, _text(self.tasks[name]), entry.scheme, entry.form, self.budget): (name, entry)
                for name, entry in left
                if name == task
            }
            try:
                for job in as_completed(jobs):
                    done(jobs[job], job.result())
            finally:
                # Also where one of them went wrong, or the user has enough.
                pool.shutdown(wait=False, cancel_futures=True)

    def _identity(self, task: LeagueTask, entry: Entry) -> dict[str, Any]:
        gains = entry.gains()
        tuned = {path: one.model_dump() for path, one in gains.tuned.items()}
        said = json.dumps([_text(task), tuned, gains.fixed], sort_keys=True)
        return {
            "version": VERSION,
            "scheme": entry.scheme,
            "form": entry.form,
            "budget": self.budget,
            "asked": hashlib.sha256(said.encode()).hexdigest()[:16],
        }

    @staticmethod
    def _path(out: Path, name: str, entry: Entry) -> Path:
        return out / "matches" / name / f"{entry.file}.json"


@dataclass(frozen=True)
class Results:
    """What came of a season.

    - `season`: who played what.
    - `matches`: by task and entry; a message where a scheme cannot be run.
    """

    season: Season
    matches: Mapping[tuple[str, Entry], Match | str]

    def on(self, task: str) -> dict[Entry, Match]:
        """The matches on a task, of those that could be run.

        - `task`: its name.
        """
        found = {entry: self.matches.get((task, entry)) for entry in self.season.entries}
        return {entry: match for entry, match in found.items() if isinstance(match, Match)}


def _text(task: LeagueTask) -> str:
    said = task.model_dump(mode="json", exclude={"uncertainty"}, exclude_unset=True)
    sets = {path: one.model_dump(mode="json", exclude_unset=True) for path, one in task.uncertainty.items()}
    return json.dumps({**said, "uncertainty": sets})


def _match(task: str, scheme: str, form: Form, budget: int) -> Match | str:
    import jax

    jax.config.update("jax_enable_x64", True)
    try:
        return played(Entry(scheme, form), LeagueTask.model_validate_json(task), tuned, budget, threads=1)
    except DefinitionError as error:
        return str(error)


def _keep(path: Path, identity: dict[str, Any], match: Match | str) -> None:
    said: dict[str, Any] = {**identity}
    if isinstance(match, str):
        said["refused"] = match
    else:
        said |= {"gains": match.gains, "cost": match.cost, "seconds": match.seconds}
        said |= {"inside": match.inside.astype(int).tolist(), "failed": match.failed.astype(int).tolist()}
        metrics = {name: np.asarray(values, object) for name, values in match.metrics.items()}
        said["metrics"] = {
            name: [float(v) if np.isfinite(float(v)) else None for v in values] for name, values in metrics.items()
        }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(said, allow_nan=False))


def _kept(path: Path, identity: dict[str, Any]) -> Match | str | None:
    """What was kept of a match; None if there is nothing, or it was another one."""
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if any(said.get(key) != value for key, value in identity.items()):
        return None
    if "refused" in said:
        return str(said["refused"])
    metrics = {name: np.array(said["metrics"][name], float) for name in KEPT}
    inside, failed = (np.array(said[name], bool) for name in ("inside", "failed"))
    return Match(said["gains"], said["cost"], inside, failed, metrics, said["seconds"])
