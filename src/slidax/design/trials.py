"""Simulation of candidate laws in common cases: the worst case of each law, and its cost.

A case has a value for each uncertain parameter of the scenario. All laws are simulated in the same, common cases.
"""

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
"""Seed of the common cases."""

PLANT, BEYOND = "robot.plant.", 1.15
"""Prefix of the arm's paths, and the factor by which the search widens their sets. Otherwise the search could end at a
loop that is nearly unstable at a corner of the set: it holds in many cases, until a longer search finds a failure."""

LOAD = "load.mass"
"""End of the path of a payload."""


@dataclass(frozen=True)
class WorstCase:
    """Worst values of a law over the common cases.

    - `choice`: values of the law.
    - `margin`: least distance to the nearer side of the envelope, over the envelope's width; negative outside.
    - `error`, `step`: largest steady error [rad or m], and largest torque step from sample to sample [N m or N].
    - `drive_share`: largest torque step, as a share of the step that the joint's drive allows.
    - `joint`: in the case with the least margin, index of the joint that left the envelope first or came nearest.
    - `guarantee_margin`: least relative margin of the law's monitor if it warns only at the envelope itself; -1 without
      a monitor.
    - `outside`, `cases`: number of cases that left the envelope, and of all cases.
    - `case`: index of the case with the least margin.
    """

    choice: DesignPoint
    margin: float
    error: float
    step: float
    joint: int
    guarantee_margin: float
    outside: int
    cases: int
    case: int = 0
    drive_share: float = 0.0

    @property
    def holds(self) -> bool:
        """True if no case left its envelope."""
        return not self.outside and bool(np.isfinite(self.error))


@dataclass(eq=False)
class Trials:
    """Simulation of candidate laws in the common cases by one compiled loop.

    - `problem`: the arm, its task and the requirements.
    - `space`: the values that are common to all laws.
    - `first`: the law for which the loop is compiled.
    - `smaller`: used share of an uncertainty set's range, from its lower end, by the dotted path of the parameter; 1
      for all other sets.
    - `harder`: hard cases that the common cases include, the newest first, in the form of `cases`.
    """

    problem: DesignProblem
    space: DesignSpace
    first: DesignPoint
    smaller: dict[str, float] = field(default_factory=dict)
    harder: Values = field(default_factory=dict)

    @property
    def runs(self) -> int:
        """Number of simulated runs of all trials that share this loop."""
        return self._runner.computed

    @property
    def most(self) -> float:
        """Largest final radius, as a factor of `space.shape`."""
        return float(np.min(LARGEST * self.space.initial / self.space.shape))

    @cached_property
    def base(self) -> ScenarioDescription:
        """The scenario with the first law."""
        return self.space.described(self.first)

    @cached_property
    def family(self) -> Family:
        """Family of scenarios with all members of the uncertainty set and all laws."""
        own = self.space.values(self.first)
        sets = {path: _set(value) for path, value in own.items()}
        return Family.of(self.base, None, TypeAdapter(Uncertainty).validate_python(sets))

    @cached_property
    def _runner(self) -> Runner:
        simulation = self.base.simulation
        samples = round(simulation.t1 / simulation.period)
        return Runner(
            StudyTask.of(self.family, "auto"),
            Runner.rows_of_chunk(samples),
            pool=_DesignPool(Cases(self.family, "auto", columns=self._columns)),
        )

    def _columns(self, run: Run) -> Columns:
        """Return outcome and metrics of runs, and `drive_share`: the largest torque step over the drive's limit."""
        columns = columns_of(run)
        steps = np.ma.filled(np.ma.asarray(steady_torque_step(run), float), np.nan)
        shares = steps.reshape(len(columns["outcome"]), -1) / self.space.changes
        return {**columns, "drive_share": shares.max(axis=1)}

    def cases(self, count: int) -> Values:
        """Return the common cases: corners of the uncertainty set, hard cases, and random cases.

        The result has an array of values for each uncertain parameter, by its dotted path; the first axis is the case.

        - `count`: number of cases.
        """
        uncertain = self.family.uncertain
        if not uncertain.sets:
            return {}
        drawn = points(SEED, 0, count, uncertain.dimensions)
        corners = _corners(uncertain, len(self.space.torque))[: max(count // 2, 1)]
        drawn[: len(corners)] = corners
        result = uncertain.values(drawn)
        for path, array in self.harder.items():
            part = result[path][len(corners) : len(corners) + len(array)]
            part[...] = array[: len(part)]
        return self._shrunk(result)

    def widened_cases(self, count: int) -> Values:
        """Return the common cases with a wider set for the arm, so that a law keeps a margin to failure.

        - `count`: number of cases.
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

    def evaluate(self, choices: Sequence[DesignPoint], cases: Values) -> list[WorstCase]:
        """Simulate laws, and return the worst case of each.

        - `choices`: the laws, all with the estimator of `first`.
        - `cases`: the cases, from `cases` or `widened_cases`.
        """
        if not choices:
            return []
        each = len(next(iter(cases.values()))) if cases else 1
        laws = [self.space.values(choice) for choice in choices]
        values = {path: np.concatenate([array] * len(choices)) for path, array in cases.items()}
        for path in laws[0]:
            values[path] = np.repeat(np.asarray([item[path] for item in laws], float), each, axis=0)
        table = self._runner.rows(0, values)
        return [_worst(choice, table, slice(k * each, (k + 1) * each)) for k, choice in enumerate(choices)]

    def with_smaller_sets(self, smaller: dict[str, float]) -> Trials:
        """Return trials with smaller uncertainty sets, in the same loop.

        - `smaller`: used share of an uncertainty set's range, as in the field `smaller`.
        """
        return self._share_compiled(replace(self, smaller=smaller))

    def with_harder(self, cases: Values) -> Trials:
        """Return trials with more hard cases among the common ones, in the same loop.

        - `cases`: the hard cases, in the form of `cases`, the worst first.
        """
        old = self.harder
        every = {path: np.concatenate([item, old[path]]) if old else item for path, item in cases.items()}
        return self._share_compiled(replace(self, harder=every))

    def _share_compiled(self, built: Trials) -> Trials:
        """Give these trials' compiled loop to other trials, and return those."""
        for name in ("base", "family", "_runner"):
            if name in self.__dict__:
                built.__dict__[name] = self.__dict__[name]
        return built

    @property
    def payload(self) -> str | None:
        """Dotted path of the uncertain payload mass; None if the payload is certain."""
        return next((path for path in self.family.uncertain.sets if path.endswith(LOAD)), None)


@dataclass
class _DesignPool(AbstractPool):
    """Runs the cases in this process, with `drive_share` among their columns."""

    cases: Cases

    def each(self, task: StudyTask, chunks: Iterator[tuple[int, Values]]) -> Iterator[tuple[int, Values, Columns]]:
        for first, values in chunks:
            yield first, values, self.cases.run(values)


def _corners(uncertain: Space, joints: int) -> Floats:
    """Return corners of the unit cube: all high, all low, alternating, and each joint against all others.

    A loop is nearest to instability for a light joint among heavy ones.
    """
    owner = np.concatenate(
        [np.arange(width) if width == joints else np.full(width, -1) for width in uncertain.widths.values()]
    )
    turns = np.arange(uncertain.dimensions) % 2 == 0
    masks = [np.ones_like(turns), ~turns, *(owner != joint for joint in range(joints))]
    return np.where(np.concatenate([(mask, ~mask) for mask in masks]), np.nextafter(1.0, 0.0), 0.0)


def _set(value: Any) -> dict[str, Any]:
    """Return an uncertainty set that ends at a value. It declares that a path varies; no values are drawn from it."""
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
    drive_share = np.where(np.isnan(part["drive_share"]), np.inf, part["drive_share"])
    guarantee_margin = part.get("guarantee_margin")
    k = int(np.argmin(margin))
    return WorstCase(
        choice,
        float(margin[k]),
        float(error.max()),
        float(step.max()),
        int(part["joint"][k]) - 1,
        -1.0 if guarantee_margin is None or np.isnan(guarantee_margin).any() else float(guarantee_margin.min()),
        int((~held).sum()),
        len(held),
        k,
        float(drive_share.max()),
    )


CALM = 0.97
"""Share of the allowed torque step for which the search aims, since other cases have larger steps."""

DRIVE_SHARE = 0.97
"""Share of the drives' largest torque step that is allowed: at their limit the drives do not follow the plan."""

OWN_DRIVE_SHARE = 0.9
"""Share of its own drive's largest torque step that each joint may use if a bound is required: the bound holds only
while no limit acts, also in other cases than the common ones."""

CALMNESS = 0.5
"""Weight of the torque step against the error if neither is required: half the error equals four times the step."""

NARROW, HARDLY = 0.1, 0.001
"""Weights of a narrow envelope, without and with a required torque step: with the first, half the final radius is worth
as much as 7 % of the error."""

OUTSIDE, NEAR, WILD, COARSE = 400.0, 300.0, 200.0, 100.0
"""Base costs of laws that leave the envelope, have too small a margin, too large a torque step, or too large an error;
each base exceeds all costs of the later kinds."""


@dataclass(frozen=True)
class Objective:
    """Cost that ranks laws by their worst cases; a lower cost is better.

    Laws that leave the envelope have the highest cost. Then follow laws with too small a margin, too large a torque
    step, and too large a steady error. All others are ranked by torque step, or by a weighted sum of the logarithms of
    steady error, torque step and final radius.

    - `step`: largest allowed torque step [N m].
    - `required`: True if `step` is a requirement; without `error`, smaller steps then have no advantage.
    - `error`: required steady error [rad or m], below which the law with the smallest step is best; None without one.
    - `room`: least allowed margin to the envelope, as a share of its width.
    - `own_share`: largest allowed `drive_share` of `WorstCase`.
    """

    step: float
    required: bool
    error: float | None
    room: float = 0.0
    own_share: float = np.inf

    def cost(self, worst: WorstCase) -> float:
        """Return the cost of a law; it is finite also for laws that fail, so that a search can improve them.

        - `worst`: the law's worst case.
        """
        if not worst.holds:
            return OUTSIDE + worst.outside - float(np.clip(worst.margin, -1.0, 1.0))
        if worst.margin < self.room:
            return NEAR - worst.margin
        error, step = np.log(max(worst.error, 1e-300)), np.log(max(worst.step, 1e-12))
        if worst.step > CALM * self.step:
            return WILD + float(step)
        if worst.drive_share > self.own_share:
            return WILD + float(np.log(worst.drive_share))
        if self.error is not None:
            return float(step) if worst.error <= self.error else COARSE + float(error)
        narrow = np.log(float(np.min(worst.choice.final)))
        return float(error + HARDLY * narrow if self.required else error + CALMNESS * step + NARROW * narrow)

    def best(self, candidates: Sequence[WorstCase]) -> WorstCase:
        """Return the candidate with the lowest cost."""
        return min(candidates, key=self.cost)

    def stricter(self, share: float) -> Objective:
        """Return the objective with smaller allowed torque steps, for a search in few cases.

        Few cases show smaller torque steps than many.

        - `share`: factor of the allowed steps.
        """
        return replace(self, step=share * self.step, own_share=share * self.own_share)
