"""Maps of the margin over one or two parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from slidax._errors import DefinitionError, counted, nearest, plain
from slidax.scenarios.description import OF_THE_LAW
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty import AbstractSet
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.scenarios.uncertainty.sets import Choice

from .asked import BELOW_ONE, Asked
from .points import points
from .result import AbstractResult, Drawn, Section, all_done, worst_of
from .study import AbstractStudy, How
from .table import Columns

MOST_AXES = 2

MOST_ROWS = 20
"""Of the table on the page; the file has all."""


class Sweep(AbstractStudy):
    """Runs all combinations of values of one or two parameters, each with the same cases of what is uncertain."""

    in_parts: ClassVar[bool] = True
    study: Literal["sweep"]
    over: Annotated[Uncertainty, Field(min_length=1, max_length=MOST_AXES)]
    """Sets by path of one or two parameters, such as `simulation.period: {choice: [5.0e-4, 1.0e-3]}`."""
    law: Literal["told", "not told"] = "told"
    """Whether the law is told the values of what is true of arm, drives and sensors, as by `--set`."""
    points: Annotated[int, Field(ge=2, le=1000)] = 21
    """Values of each parameter, from one end of its set to the other; a `choice` has its own."""
    of: str = "margin"
    """What is mapped: `margin`, or a metric such as `steady_error`; the worst of all cases."""
    cases: Annotated[int, Field(ge=1, le=1_000_000)] = 1
    """Of what is uncertain, the same at each point; with 1 the scenario's own values, and nothing is uncertain."""

    def run(self, how: How) -> SweepResult:
        """The map.

        - `how`: where, and what is told on the way.
        """
        family = self._family()
        over = {path: _axis(family, path, one, self.points) for path, one in self.over.items()}
        cases = family.uncertain.sets if self.cases > 1 else {}
        others = {path: one for path, one in cases.items() if path not in over}
        self.require(
            self.cases == 1 or bool(others),
            "cases",
            "is for a scenario with `uncertainty`; there is none besides `over`",
        )
        grid = np.meshgrid(*[np.arange(len(axis)) for axis in over.values()], indexing="ij")
        shape = grid[0].shape
        drawn = family.space.values(points(self.seed, 0, self.cases, family.space.dimensions)) if others else {}
        values = {
            path: np.repeat(axis[one.ravel()], self.cases, axis=0)
            for (path, axis), one in zip(over.items(), grid, strict=True)
        }
        values |= {path: np.concatenate([drawn[path]] * grid[0].size) for path in others}
        runner = self.runner(family, how)
        asked = Asked(runner, family.space)
        how.begin(grid[0].size * self.cases)
        table = asked.values(values)
        if self.of not in table:
            raise DefinitionError(f"there is no metric `{plain(self.of)}`; {nearest(self.of, table)}", where="of")
        return SweepResult(self, family, table, over, shape, asked.finish(), runner.computed, runner.seconds)

    def _family(self) -> Family:
        """What is swept is told to the law, or is one of the things that are true without its knowing."""
        base = self.described()
        own = self.sets(base) if self.cases > 1 else {}
        hidden = {path: one for path, one in self.over.items() if self._is_hidden(path)}
        told = {path: one for path, one in self.over.items() if path not in hidden}
        return Family.of(base, {**{path: one for path, one in own.items() if path not in told}, **hidden}, told)

    def _is_hidden(self, path: str) -> bool:
        return self.law == "not told" and path.split(".")[0] not in OF_THE_LAW and not path.startswith("robot.nominal")


def _axis(family: Family, path: str, one: AbstractSet, count: int) -> np.ndarray:
    """Values of one parameter: those of a choice, or from one end to the other by its distribution."""
    space = family.space
    # The path as the family has it: the file may have a shorter one.
    full = next((known for known in space.sets if space.sets[known] is one), path)
    if space.widths[full] != 1:
        raise DefinitionError("takes several numbers: sweep one for all joints, without `each`", where=f"over.{path}")
    places = list(space.widths)
    count = len(one.choice) if isinstance(one, Choice) and one.choice != "any" else count
    shares = (np.arange(count) + 0.5) / count if isinstance(one, Choice) else np.linspace(0.0, BELOW_ONE, count)
    cube = np.full((count, space.dimensions), 0.5)
    first = sum(space.widths[name] for name in places[: places.index(full)])
    cube[:, first] = shares
    return space.values(cube)[full]


@dataclass(frozen=True)
class SweepResult(AbstractResult):
    """A map.

    - `study`, `family`: what was asked.
    - `table`: the rows, the last parameter's values first, and of each point all cases.
    - `axes`: the values of each parameter, by its path.
    - `shape`: how many there are of each.
    - `path`: of the table; None if it was not kept.
    - `computed`, `seconds`: rows that were not stored before, and the time that they took.
    """

    study: Sweep
    family: Family
    table: Columns
    axes: dict[str, np.ndarray]
    shape: tuple[int, ...]
    path: Any
    computed: int
    seconds: float

    @property
    def runs(self) -> int:
        """How many there were."""
        return len(self.table["row"])

    @property
    def ended(self) -> str:
        """What there is."""
        return all_done(self.runs)

    @property
    def worst(self) -> np.ndarray:
        """The least margin, or the largest value of a metric, at each point [values of each parameter]."""
        numbers = self.table[self.study.of].reshape(*self.shape, -1)
        if self.study.of == "margin":
            bad = self.table["outcome"].reshape(numbers.shape) > 0
            numbers = np.where(np.isnan(numbers) & bad, -1.0, numbers)
            return np.asarray(numbers.min(axis=-1))
        return np.asarray(numbers.max(axis=-1))

    @property
    def failing(self) -> np.ndarray:
        """The share of cases that left their envelope or ended early, at each point."""
        return np.asarray((self.table["outcome"] > 0).reshape(*self.shape, -1).mean(axis=-1))

    @property
    def good(self) -> bool:
        """Whether no run failed."""
        return not np.any(self.table["outcome"] > 0)

    @property
    def lead(self) -> str:
        """The answer in a sentence."""
        size = " x ".join(map(str, self.shape))
        held = int(np.sum(self.failing == 0))
        known = self.worst[np.isfinite(self.worst)]
        said = f"{self.study.of} from {known.min():.4g} to {known.max():.4g}" if known.size else f"no {self.study.of}"
        points = "1 point" if size == "1" else f"{size} points"
        return f"{points}, {counted(self.runs, 'run')}: no run fails at {held} of {self.failing.size}; {said}."

    def sections(self) -> list[Section]:
        """The map, and the share of cases that fail if there are several."""
        from slidax.figures import parameter_map

        axes = {self._label(path): one_number(axis) for path, axis in self.axes.items()}
        is_margin = self.study.of == "margin"
        which = "Of the worst of all cases." if self.study.cases > 1 else "Of one case."
        label = ("least " if is_margin else "largest ") + self.study.of.replace("_", " ")
        maps = [Drawn("map", label, which, parameter_map(axes, self.worst, label, 0.0 if is_margin else None))]
        if self.study.cases > 1:
            share = "share of cases that fail"
            maps.append(Drawn("failing", share, f"Of {self.study.cases}.", parameter_map(axes, self.failing, share)))
        places = np.stack([one.ravel() for one in np.meshgrid(*axes.values(), indexing="ij")], axis=1)
        rows = [
            [*map(float, place), float(worst), float(failing)]
            for place, worst, failing in zip(places, self.worst.ravel(), self.failing.ravel(), strict=True)
        ]
        head = (*axes, label, "failing")
        if len(rows) <= MOST_ROWS:
            return [Section("The map", "", head, rows, maps)]
        order = np.argsort(self.worst.ravel() if is_margin else -self.worst.ravel(), kind="stable")[:MOST_ROWS]
        note = f"The table has the worst {MOST_ROWS} of {len(rows)} points."
        return [Section("The map", note, head, [rows[k] for k in order], maps)]

    def _label(self, path: str) -> str:
        known = self.family.space.leaves
        unit = next((leaf.unit for name, leaf in known.items() if name == path or name.endswith(path)), "")
        short = ".".join((self.family.label(path) if path in known else path).split(".")[-2:])
        return f"{short}  [{unit}]" if unit else short

    def as_json(self) -> dict[str, Any]:
        """The result for a program."""
        return {
            "kind": "sweep",
            "runs": self.runs,
            "failures": int(np.sum(self.table["outcome"] > 0)),
            "probability": None,
            "ended": self.ended,
            "worst": worst_of(self.table),
            "of": self.study.of,
            "axes": {path: axis.tolist() for path, axis in self.axes.items()},
            "map": _known(self.worst),
            "failing": self.failing.tolist(),
        }


def one_number(axis: np.ndarray) -> np.ndarray:
    """The values of a parameter as one number each: that of the first joint where there are several.

    - `axis`: the values, with the place first.
    """
    return np.asarray(axis, float).reshape(len(axis), -1)[:, 0]


def _known(numbers: np.ndarray) -> Any:
    """Lists of numbers, with None for what is not known."""
    plain = numbers.astype(object)
    plain[~np.isfinite(numbers)] = None
    return plain.tolist()
