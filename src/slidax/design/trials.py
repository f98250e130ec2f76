"""Candidates on common cases of the uncertainty set: the worst case of each, and its cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from slidax.analysis.metrics import steady_torque_step
from slidax.scenarios.family import Family, Space
from slidax.scenarios.scenario import ScenarioDescription
from slidax.scenarios.uncertainty import Uncertainty
from slidax.simulation.run import Run
from slidax.studies.cases import Cases, Columns, StudyTask, Values, columns_of, points
from slidax.studies.predicates import ENVELOPE, Predicate
from slidax.studies.runner import AbstractPool, Runner

from .candidates import LARGEST, DesignPoint, DesignSpace, Floats
from .problem import DesignProblem

SEED = 0
"""Of the common cases."""

PLANT, BEYOND = "robot.plant.", 1.15
"""Of the arm is unknown so many times as much in the search as in the set: a loop that is nearly unstable at a corner
holds in many cases, and a longer search finds one in which it does not."""

LOAD = "load.mass"
"""End of the path of a payload."""


@dataclass(frozen=True)
class WorstCase:
    """Worst of the common cases for a choice.

    - `choice`: its numbers.
    - `margin`: least distance to the envelope's nearer side over its width; negative outside.
    - `error`, `step`: largest steady error [rad or m] and change of torque in a period [N m or N].
    - `driven`: the largest of these over what the joint's own drive can do in a period.
    - `joint`: which is nearest to its envelope in the worst case, from 0.
    - `promise`: least margin of the monitor, with the whole envelope as its share.
    - `outside`: how many cases left; `cases`: of how many; `case`: which has the least margin, from 0.
    """

    choice: DesignPoint
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
    frame: DesignSpace
    first: DesignPoint
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
            StudyTask.of(self.family, "auto"),
            Runner.rows_of_chunk(samples),
            pool=_Driven(Cases(self.family, "auto", columns=self._columns)),
        )

    def _columns(self, run: Run) -> Columns:
        """Outcome and metrics of runs, and their steady torque steps over what each joint's drive allows."""
        columns = columns_of(run)
        steps = np.ma.filled(np.ma.asarray(steady_torque_step(run), float), np.nan)
        shares = steps.reshape(len(columns["outcome"]), -1) / self.frame.changes
        return {**columns, "driven": shares.max(axis=1)}

    def cases(self, count: int) -> Values:
        """Corners of the uncertain set, cases that were hard, and points drawn in it; none where nothing is uncertain.

        - `count`: how many.
        """
        space = self.family.uncertain
        if not space.sets:
            return {}
        drawn = points(SEED, 0, count, space.dimensions)
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

    def judged(self, choices: Sequence[DesignPoint], cases: Values) -> list[WorstCase]:
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

    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
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


def _worst(choice: DesignPoint, table: Columns, rows: slice) -> WorstCase:
    part = {name: column[rows] for name, column in table.items()}
    held = Predicate(ENVELOPE).holds(part)
    margin = np.where(np.isnan(part["margin"]), -1.0, part["margin"])
    error = np.where(np.isnan(part["steady_error"]), np.inf, part["steady_error"])
    step = np.where(np.isnan(part["steady_torque_step"]), np.inf, part["steady_torque_step"])
    driven = np.where(np.isnan(part["driven"]), np.inf, part["driven"])
    promise = part.get("guarantee_margin")
    k = int(np.argmin(margin))
    return WorstCase(
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


CALM = 0.97
"""Of the torque step that is allowed, since other cases show some more."""

DRIVEN = 0.97
"""Of what the drives can do in a period, that is allowed: at their limit a plan is not carried out."""

OWN = 0.9
"""Of what its own drive can do in a period, that a joint may use where a certificate is required: that begins after the
last limit, and its cases are not the common ones."""

CALMNESS = 0.5
"""The weight of the torque step beside the error, where neither is required: half the error is worth four times the
step."""

NARROW, HARDLY = 0.1, 0.001
"""The weight of a narrow envelope: half the final radius is worth 7 % of the error, below a required step hardly."""

OUTSIDE, NEAR, WILD, COARSE = 400.0, 300.0, 200.0, 100.0
"""Costs of a law that leaves, or comes too near, or is too wild, or not exact enough: more than any of a law that is
better in that."""


@dataclass(frozen=True)
class Objective:
    """Laws that all cases keep with some room; of those the calm ones; of those the exact ones; of those the best.

    - `step`: largest change of torque that is allowed [N m].
    - `required`: whether it is a requirement, so that below it nothing is gained by less.
    - `error`: the steady error that is small enough, so that below it the calmest is best [rad]; None for none.
    - `room`: of an envelope's width, that the worst case must leave.
    - `own`: of what its own drive can do in a period, that the torque step of each joint may be.
    """

    step: float
    required: bool
    error: float | None
    room: float = 0.0
    own: float = np.inf

    def cost(self, worst: WorstCase) -> float:
        """The smaller, the better; finite, so that a search finds its way.

        - `worst`: of a candidate law.
        """
        if not worst.holds:
            return OUTSIDE + worst.outside - float(np.clip(worst.margin, -1.0, 1.0))
        if worst.margin < self.room:
            return NEAR - worst.margin
        error, step = np.log(max(worst.error, 1e-300)), np.log(max(worst.step, 1e-12))
        if worst.step > CALM * self.step:
            return WILD + float(step)
        if worst.driven > self.own:
            return WILD + float(np.log(worst.driven))
        if self.error is not None:
            return float(step) if worst.error <= self.error else COARSE + float(error)
        narrow = np.log(float(np.min(worst.choice.final)))
        return float(error + HARDLY * narrow if self.required else error + CALMNESS * step + NARROW * narrow)

    def best(self, candidates: Sequence[WorstCase]) -> WorstCase:
        """The one that costs least.

        - `candidates`: judged laws.
        """
        return min(candidates, key=self.cost)

    def stricter(self, share: float) -> Objective:
        """The same with a smaller step: few cases show less of it than many.

        - `share`: of the step.
        """
        return replace(self, step=share * self.step, own=share * self.own)
