"""Candidates on common cases of the uncertainty set: the worst case of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from slidax.metrics import steady_torque_step
from slidax.scenarios import ScenarioDescription
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty import Space
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.simulation import Run
from slidax.studies.cases import Cases, Values
from slidax.studies.points import points
from slidax.studies.predicate import ENVELOPE, Predicate
from slidax.studies.runner import AbstractPool, Runner
from slidax.studies.table import Columns, columns_of
from slidax.studies.task import Task

from .choice import LARGEST, Choice, Floats, Frame
from .requirements import DesignProblem

SEED = 0
"""Of the common cases."""

PLANT, BEYOND = "robot.plant.", 1.15
"""Of the arm is unknown so many times as much in the search as in the set: a loop that is nearly unstable at a corner
holds in many cases, and a longer search finds one in which it does not."""

LOAD = "load.mass"
"""End of the path of a payload."""


@dataclass(frozen=True)
class Worst:
    """Worst of the common cases for a choice.

    - `choice`: its numbers.
    - `margin`: least distance to the envelope's nearer side over its width; negative outside.
    - `error`, `step`: largest steady error [rad or m] and change of torque in a period [N m or N].
    - `driven`: the largest of these over what the joint's own drive can do in a period.
    - `joint`: which is nearest to its envelope in the worst case, from 0.
    - `promise`: least margin of the monitor, with the whole envelope as its share.
    - `outside`: how many cases left; `cases`: of how many; `case`: which has the least margin, from 0.
    """

    choice: Choice
    margin: float
    error: float
    step: float
    joint: int
    promise: float
    outside: int
    cases: int
    case: int = 0
    driven: float = 0.0

    @property
    def holds(self) -> bool:
        """True if no case left its envelope."""
        return not self.outside and bool(np.isfinite(self.error))


@dataclass(eq=False)
class Trials:
    """Runs choices on the same cases, through one compiled loop.

    - `requirements`: of the law.
    - `frame`: what all choices have in common.
    - `first`: the choice of which the loop is made.
    - `smaller`: paths whose sets are used up to this share of their width.
    """

    problem: DesignProblem
    frame: Frame
    first: Choice
    smaller: dict[str, float] = field(default_factory=dict)
    harder: Values = field(default_factory=dict)

    @property
    def runs(self) -> int:
        """Number of simulated runs, with all trials that share this loop."""
        return self._runner.computed

    @property
    def most(self) -> float:
        """The largest final radius, times the shape."""
        return float(np.min(LARGEST * self.frame.initial / self.frame.shape))

    @cached_property
    def base(self) -> ScenarioDescription:
        """The scenario with the first choice."""
        return self.frame.described(self.first)

    @cached_property
    def family(self) -> Family:
        """All scenarios that may be, and all choices."""
        own = self.frame.values(self.first)
        sets = {path: _set(value) for path, value in own.items()}
        return Family.of(self.base, None, TypeAdapter(Uncertainty).validate_python(sets))

    @cached_property
    def _runner(self) -> Runner:
        simulation = self.base.simulation
        samples = round(simulation.t1 / simulation.period)
        return Runner(
            Task.of(self.family, "auto"),
            Runner.rows_of_chunk(samples),
            pool=_Driven(Cases(self.family, "auto", columns=self._columns)),
        )

    def _columns(self, run: Run) -> Columns:
        """Outcome and metrics of runs, and their steady torque steps over what each joint's drive allows."""
        columns = columns_of(run)
        steps = np.ma.filled(np.ma.asarray(steady_torque_step(run), float), np.nan)
        shares = steps.reshape(len(columns["outcome"]), -1) / self.frame.changes
        return {**columns, "driven": shares.max(axis=1)}

    def cases(self, count: int, seed: int = SEED) -> Values:
        """Corners of the uncertain set, cases that were hard, and points drawn in it; none where nothing is uncertain.

        - `count`: how many.
        - `seed`: of those that are drawn.
        """
        space = self.family.uncertain
        if not space.sets:
            return {}
        drawn = points(seed, 0, count, space.dimensions)
        corners = _corners(space, len(self.frame.torque))[: max(count // 2, 1)]
        drawn[: len(corners)] = corners
        result = space.values(drawn)
        for path, array in self.harder.items():
            room = result[path][len(corners) : len(corners) + len(array)]
            room[...] = array[: len(room)]
        return self._shrunk(result)

    def beyond(self, count: int) -> Values:
        """The same cases of an arm that is unknown by more, so that a law is not at the edge of what it bears.

        - `count`: how many.
        """
        result = dict(self.cases(count))
        ends = self.family.uncertain.values(_corners(self.family.uncertain, 0)[:2]) if result else {}
        for path, array in result.items():
            if path.startswith(PLANT) and np.issubdtype(array.dtype, np.floating):
                high, low = ends[path]
                wider = low + (high - low) * 0.5 + BEYOND * (array - low - (high - low) * 0.5)
                # Values that are never negative in the set stay so.
                result[path] = np.where(low >= 0.0, np.maximum(wider, 0.5 * low), wider)
        return result

    def _shrunk(self, values: Values) -> Values:
        low = self.family.uncertain.values(np.zeros((1, self.family.uncertain.dimensions)))
        share = {path: self.smaller.get(path, 1.0) for path in values}
        return {path: low[path] + share[path] * (array - low[path]) for path, array in values.items()}

    def judged(self, choices: Sequence[Choice], cases: Values) -> list[Worst]:
        """Return the worst case of each choice.

        - `choices`: all with the estimator of the first.
        - `cases`: as `cases` gives them.
        """
        if not choices:
            return []
        each = len(next(iter(cases.values()))) if cases else 1
        told = [self.frame.values(choice) for choice in choices]
        values = {path: np.concatenate([array] * len(choices)) for path, array in cases.items()}
        for path in told[0]:
            values[path] = np.repeat(np.asarray([item[path] for item in told], float), each, axis=0)
        table = self._runner.rows(0, values)
        return [_worst(choice, table, slice(k * each, (k + 1) * each)) for k, choice in enumerate(choices)]

    def with_less(self, smaller: dict[str, float]) -> Trials:
        """The same loop on a part of the set.

        - `smaller`: paths, and the share of the width of their sets that is used.
        """
        return self._sharing(replace(self, smaller=smaller))

    def with_harder(self, cases: Values) -> Trials:
        """The same loop on common cases of which some are these, before those that were hard already.

        - `cases`: by path, the worst first.
        """
        old = self.harder
        every = {path: np.concatenate([item, old[path]]) if old else item for path, item in cases.items()}
        return self._sharing(replace(self, harder=every))

    def _sharing(self, built: Trials) -> Trials:
        """Another one with what is compiled."""
        for name in ("base", "family", "_runner"):
            if name in self.__dict__:
                built.__dict__[name] = self.__dict__[name]
        return built

    @property
    def payload(self) -> str | None:
        """The path of an uncertain payload, if there is one."""
        return next((path for path in self.family.uncertain.sets if path.endswith(LOAD)), None)


@dataclass
class _Driven(AbstractPool):
    """In this process, by cases that say what their drives do."""

    cases: Cases

    def each(self, task: Task, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        for first, values in chunks:
            yield first, values, self.cases.run(values)


def _corners(space: Space, joints: int) -> Floats:
    """Of the unit cube: all high, all low, by turns, and one joint's numbers against those of all others.

    A light joint among heavy ones is where a loop is nearest to oscillating.
    """
    owner = np.concatenate(
        [np.arange(width) if width == joints else np.full(width, -1) for width in space.widths.values()]
    )
    turns = np.arange(space.dimensions) % 2 == 0
    masks = [np.ones_like(turns), ~turns, *(owner != joint for joint in range(joints))]
    return np.where(np.concatenate([(mask, ~mask) for mask in masks]), np.nextafter(1.0, 0.0), 0.0)


def _set(value: Any) -> dict[str, Any]:
    """A set around a value, which gives it its form; rows are given as they are."""
    if np.ndim(value):
        numbers = np.asarray(value, float).tolist()
        return {"between": [[item / 1.5 for item in numbers], numbers], "each": "joint"}
    return {"between": [float(value) / 1.5, float(value)]}


def _worst(choice: Choice, table: Columns, rows: slice) -> Worst:
    part = {name: column[rows] for name, column in table.items()}
    held = Predicate(ENVELOPE).holds(part)
    margin = np.where(np.isnan(part["margin"]), -1.0, part["margin"])
    error = np.where(np.isnan(part["steady_error"]), np.inf, part["steady_error"])
    step = np.where(np.isnan(part["steady_torque_step"]), np.inf, part["steady_torque_step"])
    driven = np.where(np.isnan(part["driven"]), np.inf, part["driven"])
    promise = part.get("guarantee_margin")
    k = int(np.argmin(margin))
    return Worst(
        choice,
        float(margin[k]),
        float(error.max()),
        float(step.max()),
        int(part["joint"][k]) - 1,
        -1.0 if promise is None or np.isnan(promise).any() else float(promise.min()),
        int((~held).sum()),
        len(held),
        k,
        float(driven.max()),
    )
