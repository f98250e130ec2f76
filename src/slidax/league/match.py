"""One scheme on one task: tuned on the training cases, then scored on held-out cases."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty.space import as_changes
from slidax.studies.cases import Cases, Values
from slidax.studies.points import points
from slidax.studies.table import OUTCOMES, Columns

from .entry import BenchmarkEntry
from .task import BenchmarkTask, CasesDescription

ENDED = [OUTCOMES.index("left_envelope"), OUTCOMES.index("not_finite")]

KEPT = ("steady_error", "peak_torque", "max_torque_step", "steady_torque_step", "torque_energy", "tolerance_margin")
"""Metrics that are kept of each held-out case, each of its worst joint."""

Tuner = Callable[[Callable[[NDArray[Any]], NDArray[Any]], int, int], NDArray[Any]]
"""From an objective on points of the unit cube, its dimension and a budget of points, to the best point."""


@dataclass(frozen=True)
class TaskResult:
    """Result of a scheme on a task.

    - `gains`: the tuned ones, by path.
    - `cost`: mean of `costs` over the training cases.
    - `inside`: True if the held-out case never left the tolerance band [cases].
    - `failed`: True if the case was lost: not finite, or steady errors above the band's initial radius [cases].
    - `metrics`: `KEPT`, by name [cases].
    - `seconds`: wall-clock time.
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

    - `budget`: largest number of points for the tuner.
    - `threads`: of the native engine.

    Raises DefinitionError if the scheme does not fit the task.
    """
    started = time.perf_counter()
    with warnings.catch_warnings():
        # Some gains in the ranges only suit other arms.
        warnings.simplefilter("ignore")
        base = entry.described(task)
        family = Family.of(base, task.uncertainty, entry.gains().sets(base))
        cases = Cases(family, threads=threads, name=entry.file)
        training, scale = drawn(family, task.training), Scale.of(family)

        def objective(cube: NDArray[Any]) -> NDArray[Any]:
            count, each = len(cube), task.training.cases
            tried = family.varied.values(cube)
            values = {path: np.tile(array, (count, *[1] * (array.ndim - 1))) for path, array in training.items()}
            values |= {path: np.repeat(array, each, axis=0) for path, array in tried.items()}
            return costs(cases.run(values), scale).reshape(count, each).mean(axis=1)

        dimension = family.varied.dimensions
        best = np.clip(tuner(objective, dimension, budget), 0.0, np.nextafter(1.0, 0.0))
        gains = {path: array[0] for path, array in family.varied.values(best[None]).items()}
        held = drawn(family, task.held_out)
        fixed = {path: np.broadcast_to(array, (task.held_out.cases, *array.shape)) for path, array in gains.items()}
        columns = cases.run({**held, **fixed})
        cost = float(objective(best[None])[0])
    inside, failed = inside_of(columns), failed_of(columns, scale)
    kept = {name: np.asarray(columns[name], float) for name in KEPT}
    return TaskResult(as_changes(gains), cost, inside, failed, kept, time.perf_counter() - started)


def drawn(family: Family, cases: CasesDescription) -> Values:
    """Draw the uncertain values of each case."""
    space = family.uncertain
    return space.values(points(cases.seed, 0, cases.cases, space.dimensions))


@dataclass(frozen=True)
class Scale:
    """Scales of a task's errors and torques, each the largest of all joints.

    - `initial`, `final`: radii of the tolerance band [rad or m].
    - `torque`: limit of the drives [N m or N]; infinite without limits.
    """

    initial: float
    final: float
    torque: float

    @classmethod
    def of(cls, family: Family) -> Scale:
        """Return the scales of a family.

        Raises DefinitionError if its scenarios have no tolerance band.
        """
        tolerance = family.base.tolerance
        if tolerance is None:
            raise DefinitionError("a task of the benchmark needs a tolerance band")
        performance: Any = tolerance.build().performance
        torque = family.base.moving().drive.limits().torque
        return cls(*(float(np.max(np.asarray(each))) for each in (performance.initial, performance.final, torque)))


def inside_of(columns: Columns) -> NDArray[np.bool_]:
    """Return True for each case that reached its end and never left the tolerance band."""
    return (columns["tolerance_violations"] == 0) & ~np.isin(columns["outcome"], ENDED)


def failed_of(columns: Columns, scale: Scale) -> NDArray[np.bool_]:
    """Return True for each lost case: not finite, or a steady error above the tolerance band's initial radius."""
    return np.isin(columns["outcome"], ENDED) | ~(columns["steady_error"] <= scale.initial)


def costs(columns: Columns, scale: Scale) -> NDArray[Any]:
    """Return the tuner's cost of each case.

    Inside the tolerance band `½ √(e/ρ∞) + ½ √(Δτ/τ_max)`, below 1, with the worst joint's steady error and steady
    torque step. Outside `1 + min(8, -m) + n/(n + 100)`, with the margin m and n samples outside: below 10. For a run
    that ended at t `20 - t/(1 s + t)`.
    """
    error = np.sqrt(np.minimum(columns["steady_error"] / scale.final, 1.0))
    step = np.sqrt(np.minimum(columns["steady_torque_step"] / scale.torque, 1.0))
    good = 0.5 * np.nan_to_num(error, nan=1.0) + 0.5 * np.nan_to_num(step, nan=1.0)
    depth = np.clip(-np.nan_to_num(columns["tolerance_margin"], nan=-8.0), 0.0, 8.0)
    outside = columns["tolerance_violations"]
    bad = 1.0 + depth + outside / (outside + 100.0)
    ended = np.isin(columns["outcome"], ENDED)
    early = 20.0 - np.nan_to_num(columns["t"] / (1.0 + columns["t"]), nan=0.0)
    return np.where(ended, early, np.where(inside_of(columns), good, bad))
