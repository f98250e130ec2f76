"""Maps of a margin or a metric over one or two parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax.core.errors import DefinitionError, count_noun
from slidax.core.files import json_value
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import OF_THE_LAW
from slidax.scenarios.uncertainty import AbstractSet, Discrete, Uncertainty

from .cases import LARGER_IS_BETTER, points, require_metric
from .runner import BELOW_ONE, BatchEvaluator
from .study import AbstractStudy, AbstractTableResult, Chart, RunOptions, Section, all_done, worst_row

MOST_AXES = 2

MOST_ROWS = 20
"""Largest number of rows in the table of the page; the file has all points."""


class Sweep(AbstractStudy):
    """Runs all combinations of values of one or two parameters, each on the same random cases."""

    in_parts: ClassVar[bool] = True
    study: Literal["sweep"]
    over: Annotated[Uncertainty, Field(min_length=1, max_length=MOST_AXES)]
    """Sets of values, by path, of one or two parameters, such as `simulation.period: {choice: [5.0e-4, 1.0e-3]}`."""
    law: Literal["told", "not told"] = "told"
    """`told`: the law knows the swept values of arm, drives and sensors, as with `--set`; `not told`: it does not."""
    points: Annotated[int, Field(ge=2, le=1000)] = 21
    """Number of values of each parameter, from end to end of its set; a `choice` has its own."""
    of: str = "margin"
    """Mapped quantity: `margin`, or a metric such as `steady_error`; a point of the map has its worst case's value."""
    cases: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """Number of random cases, the same at each point; 1 for the scenario's own values without uncertainty."""

    def run(self, how: RunOptions) -> SweepResult:
        family = self._family()
        over = {path: _axis(family, path, own, self.points) for path, own in self.over.items()}
        cases = family.uncertain.sets if self.cases > 1 else {}
        others = {path: own for path, own in cases.items() if path not in over}
        self.require(
            self.cases == 1 or bool(others),
            "cases",
            "greater than 1 needs uncertain values in addition to those in `over`: add sets to `uncertainty`, or set 1",
        )
        grid = np.meshgrid(*[np.arange(len(axis)) for axis in over.values()], indexing="ij")
        shape = grid[0].shape
        drawn = family.space.values(points(self.seed, 0, self.cases, family.space.dimensions)) if others else {}
        values = {
            path: np.repeat(axis[indices.ravel()], self.cases, axis=0)
            for (path, axis), indices in zip(over.items(), grid, strict=True)
        }
        values |= {path: np.concatenate([drawn[path]] * grid[0].size) for path in others}
        evaluated = BatchEvaluator(self.runner(family, how), family)
        how.begin(grid[0].size * self.cases)
        table = evaluated.values(values)
        require_metric(self.of, table, "of")
        return SweepResult(study=self, **evaluated.collected(), axes=over, shape=shape)

    def _family(self) -> Family:
        """Return the family of scenarios; the field `law` decides if the law knows the swept values."""
        base = self.described()
        own = self.sets(base) if self.cases > 1 else {}
        hidden = {path: own for path, own in self.over.items() if self._is_hidden(path)}
        known = {path: axis for path, axis in self.over.items() if path not in hidden}
        return Family.of(base, {**{path: leaf for path, leaf in own.items() if path not in known}, **hidden}, known)

    def _is_hidden(self, path: str) -> bool:
        return self.law == "not told" and path.split(".")[0] not in OF_THE_LAW and not path.startswith("robot.nominal")


def _axis(family: Family, path: str, values: AbstractSet, count: int) -> np.ndarray:
    """Return the swept values of a parameter: all of a choice, or `count` from end to end of its distribution."""
    space = family.space
    # The full path in the family: the study file may abbreviate it.
    full = next((known for known in space.sets if space.sets[known] is values), path)
    if space.widths[full] != 1:
        raise DefinitionError(
            "has several numbers: sweep a single value for all joints, without `each`", where=f"over.{path}"
        )
    paths = list(space.widths)
    count = len(values.choice) if isinstance(values, Discrete) and values.choice != "any" else count
    shares = (np.arange(count) + 0.5) / count if isinstance(values, Discrete) else np.linspace(0.0, BELOW_ONE, count)
    cube = np.full((count, space.dimensions), 0.5)
    first = sum(space.widths[name] for name in paths[: paths.index(full)])
    cube[:, first] = shares
    return space.values(cube)[full]


@dataclass(frozen=True)
class SweepResult(AbstractTableResult):
    """Result of a sweep. The rows of `table` are in C order of the axes [parameters ..., case].

    - `axes`: swept values of each parameter, by path; the first axis is the value.
    - `shape`: number of values of each parameter.
    """

    study: Sweep
    axes: dict[str, np.ndarray]
    shape: tuple[int, ...]

    @property
    def ended(self) -> str:
        """The sentence “all N runs are done”."""
        return all_done(self.runs)

    @property
    def worst(self) -> np.ndarray:
        """Worst value over the cases for each parameter combination, as an array of `shape`."""
        numbers = self.table[self.study.of].reshape(*self.shape, -1)
        if self.study.of == "margin":
            bad = self.table["outcome"].reshape(numbers.shape) > 0
            numbers = np.where(np.isnan(numbers) & bad, -1.0, numbers)
            return np.asarray(numbers.min(axis=-1))
        return np.asarray(numbers.min(axis=-1) if self.study.of in LARGER_IS_BETTER else numbers.max(axis=-1))

    @property
    def failing(self) -> np.ndarray:
        """Share of cases that left their envelope or ended early, for each parameter combination; array of `shape`."""
        return np.asarray((self.table["outcome"] > 0).reshape(*self.shape, -1).mean(axis=-1))

    @property
    def summary(self) -> str:
        size = " x ".join(map(str, self.shape))
        held = int(np.sum(self.failing == 0))
        known = self.worst[np.isfinite(self.worst)]
        ends = f"{self.study.of} from {known.min():.4g} to {known.max():.4g}" if known.size else f"no {self.study.of}"
        points = "1 point" if size == "1" else f"{size} points"
        return f"{points}, {count_noun(self.runs, 'run')}: no run fails at {held} of {self.failing.size}; {ends}."

    def sections(self) -> list[Section]:
        axes = {self._label(path): one_number(axis) for path, axis in self.axes.items()}
        is_margin, larger_is_better = self.study.of == "margin", self.study.of in LARGER_IS_BETTER
        caption = "The worst case at each point." if self.study.cases > 1 else "A single case."
        label = ("least " if larger_is_better else "largest ") + self.study.of.replace("_", " ")
        maps = [Chart("map", label, caption, "parameter_map", (axes, self.worst, label, 0.0 if is_margin else None))]
        if self.study.cases > 1:
            share = "share of cases that fail"
            maps.append(
                Chart("failing", share, f"Of {self.study.cases} cases.", "parameter_map", (axes, self.failing, share))
            )
        grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes.values(), indexing="ij")], axis=1)
        rows = [
            [*map(float, point), float(worst), float(failing)]
            for point, worst, failing in zip(grid, self.worst.ravel(), self.failing.ravel(), strict=True)
        ]
        head = (*axes, label, "Failing")
        if len(rows) <= MOST_ROWS:
            return [Section("The map", "", head, rows, maps)]
        badness = self.worst.ravel() if larger_is_better else -self.worst.ravel()
        # A point without a value is one whose run diverged: it is worse than all others.
        badness = np.where(np.isnan(badness), -np.inf, badness)
        order = np.argsort(badness, kind="stable")[:MOST_ROWS]
        note = f"The table has the worst {MOST_ROWS} of {len(rows)} points."
        return [Section("The map", note, head, [rows[k] for k in order], maps)]

    def _label(self, path: str) -> str:
        known = self.family.space.leaves
        unit = next((leaf.unit for name, leaf in known.items() if name == path or name.endswith(path)), "")
        short = ".".join((self.family.label(path) if path in known else path).split(".")[-2:])
        return f"{short}  [{unit}]" if unit else short

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": "sweep",
            "runs": self.runs,
            "failures": self.failures,
            "probability": None,
            "ended": self.ended,
            "worst": worst_row(self.table),
            "of": self.study.of,
            "axes": {path: axis.tolist() for path, axis in self.axes.items()},
            "map": json_value(self.worst),
            "failing": self.failing.tolist(),
        }


def one_number(axis: np.ndarray) -> np.ndarray:
    """Return one number for each swept value: the first joint's if a value has a number for each joint."""
    return np.asarray(axis, float).reshape(len(axis), -1)[:, 0]
