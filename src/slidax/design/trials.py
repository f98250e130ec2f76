"""Candidates on common cases of the uncertain set: what the worst case makes of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from slidax.scenarios import ScenarioDescription
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.studies.cases import Values
from slidax.studies.points import points
from slidax.studies.predicate import ENVELOPE, Predicate
from slidax.studies.runner import Runner
from slidax.studies.table import Columns
from slidax.studies.task import Task

from .choice import LARGEST, Choice, Frame
from .requirements import Requirements

Floats = NDArray[np.floating[Any]]

SEED = 0
"""Of the common cases."""

LOAD = "load.mass"
"""How the path of a payload ends."""


@dataclass(frozen=True)
class Worst:
    """What the worst of the common cases makes of a choice.

    - `choice`: its numbers.
    - `margin`: least distance to the envelope's nearer side over its width; negative outside.
    - `error`, `step`: largest steady error [rad or m] and change of torque in a period [N m or N].
    - `joint`: which is nearest to its envelope in the worst case, from 0.
    - `promise`: least margin of the monitor, with the whole envelope as its share.
    - `outside`: how many cases left; `cases`: of how many.
    """

    choice: Choice
    margin: float
    error: float
    step: float
    joint: int
    promise: float
    outside: int
    cases: int

    @property
    def holds(self) -> bool:
        """Whether no case left its envelope."""
        return not self.outside and bool(np.isfinite(self.error))


@dataclass(eq=False)
class Trials:
    """Runs choices on the same cases, through one compiled loop.

    - `requirements`: of the law.
    - `frame`: what all choices have in common.
    - `first`: the choice of which the loop is made.
    - `period`: in place of the stated one [s].
    - `smaller`: paths whose sets are used up to this share of their width.
    """

    requirements: Requirements
    frame: Frame
    first: Choice
    period: float | None = None
    smaller: dict[str, float] = field(default_factory=dict)
    runs: int = field(default=0, init=False)

    @property
    def most(self) -> float:
        """The largest final radius, times the shape."""
        return float(np.min(LARGEST * self.frame.initial / self.frame.shape))

    @cached_property
    def base(self) -> ScenarioDescription:
        """The scenario with the first choice."""
        return self.requirements.scenario(self.frame.scheme(self.first), period=self.period)

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
        return Runner(Task.of(self.family, "auto"), Runner.rows_of_chunk(samples))

    def cases(self, count: int, seed: int = SEED) -> Values:
        """Corners of the uncertain set, and points drawn in it, by path; no paths where nothing is uncertain.

        - `count`: how many.
        - `seed`: of those that are drawn.
        """
        space = self.family.uncertain
        if not space.sets:
            return {}
        drawn = points(seed, 0, count, space.dimensions)
        low, high = np.zeros(space.dimensions), np.full(space.dimensions, np.nextafter(1.0, 0.0))
        turns = np.arange(space.dimensions) % 2 == 0
        corners = np.array([high, low, np.where(turns, low, high), np.where(turns, high, low)])[: max(count // 2, 1)]
        drawn[: len(corners)] = corners
        return self._shrunk(space.values(drawn))

    def _shrunk(self, values: Values) -> Values:
        low = self.family.uncertain.values(np.zeros((1, self.family.uncertain.dimensions)))
        share = {path: self.smaller.get(path, 1.0) for path in values}
        return {path: low[path] + share[path] * (array - low[path]) for path, array in values.items()}

    def judged(self, choices: Sequence[Choice], cases: Values) -> list[Worst]:
        """What the worst case makes of each.

        - `choices`: all with the estimator of the first.
        - `cases`: as `cases` gives them.
        """
        if not choices:
            return []
        each = len(next(iter(cases.values()))) if cases else 1
        told = [self.frame.values(choice) for choice in choices]
        values = {path: np.concatenate([array] * len(choices)) for path, array in cases.items()}
        for path in told[0]:
            values[path] = np.repeat(np.asarray([one[path] for one in told], float), each, axis=0)
        table = self._runner.rows(0, values)
        self.runs += each * len(choices)
        return [_worst(choice, table, slice(k * each, (k + 1) * each)) for k, choice in enumerate(choices)]

    def with_less(self, smaller: dict[str, float]) -> Trials:
        """The same loop on a part of the set.

        - `smaller`: paths, and the share of the width of their sets that is used.
        """
        made = replace(self, smaller=smaller)
        for name in ("base", "family", "_runner"):
            if name in self.__dict__:
                made.__dict__[name] = self.__dict__[name]
        return made

    @property
    def payload(self) -> str | None:
        """The path of an uncertain payload, if there is one."""
        return next((path for path in self.family.uncertain.sets if path.endswith(LOAD)), None)


def _set(value: Any) -> dict[str, Any]:
    """A set around a value, which gives it its form; rows are given as they are."""
    if np.ndim(value):
        numbers = np.asarray(value, float).tolist()
        return {"between": [[one / 1.5 for one in numbers], numbers], "each": "joint"}
    return {"between": [float(value) / 1.5, float(value)]}


def _worst(choice: Choice, table: Columns, rows: slice) -> Worst:
    part = {name: column[rows] for name, column in table.items()}
    held = Predicate(ENVELOPE).holds(part)
    margin = np.where(np.isnan(part["margin"]), -1.0, part["margin"])
    error = np.where(np.isnan(part["steady_error"]), np.inf, part["steady_error"])
    step = np.where(np.isnan(part["steady_torque_step"]), np.inf, part["steady_torque_step"])
    promise = part.get("promise_margin")
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
    )
