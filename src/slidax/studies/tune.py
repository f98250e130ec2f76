"""The gains that are best for all that may be."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from slidax.scenarios.base import said
from slidax.scenarios.family import Family
from slidax.scenarios.uncertainty.mapping import Uncertainty
from slidax.scenarios.uncertainty.space import as_changes

from .asked import BELOW_ONE, Asked
from .cases import Values
from .gains import OnCases, judged, point_of_own
from .points import points
from .predicate import ENVELOPE, Predicate
from .search import Front, several_aims
from .study import AbstractStudy, How
from .table import Columns
from .tuned import Tuned, rows_of

AIMS = ("steady_error", "steady_torque_step", "peak_torque")


class Tune(AbstractStudy):
    """Searches for gains on some cases of what is uncertain, and judges the best of them on others.

    Every candidate is run on the same cases. Those for which something does not hold in one of them are out; of the
    others the front is kept: candidates that no other beats in all aims. The aims of today's gains, and of the front,
    are then measured on cases that the search has not seen.
    """

    study: Literal["tune"]
    gains: Annotated[Uncertainty, Field(min_length=1)]
    """Sets by path of what may be chosen, such as `scheme.surface.k1: {between: [0.1, 2]}`."""
    aims: Annotated[tuple[str, ...], Field(min_length=1)] = AIMS
    """Metrics that are to be small, in the mean over the cases."""
    holds: tuple[str, ...] = (ENVELOPE,)
    """Properties that must hold in every case: `envelope`, or a metric, a sign and a number."""
    margin: float = said(
        "the least margin that every case must have, so that others hold, too", "", "[0, 1)", default=0.0
    )
    cases: Annotated[int, Field(ge=1, le=100_000)] = 16
    """On how many each candidate is judged; one if nothing is uncertain."""
    candidates: Annotated[int, Field(ge=1, le=10_000_000)] = 600
    """Largest number of candidates."""
    seconds: float | None = said(
        "after so many no batch begins; the rows then depend on the machine", "s", "> 0", default=None
    )
    held_out: Annotated[int, Field(ge=1, le=10_000_000)] = 200
    """Cases that the front is judged on afterwards."""
    keep: Annotated[int, Field(ge=1, le=1000)] = 12
    """Number of candidates of the front that are kept, spread along it."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    def run(self, how: How) -> Tuned:
        """The front.

        - `how`: where, and what is told on the way.
        """
        holds = [Predicate(text) for text in self.holds]
        family = self.family(self.gains)
        known, unseen = self._cases(family)
        runner = self.runner(family, how)
        evaluated = Asked(runner, family)
        on = OnCases(evaluated, family.varied, known, self.aims, holds, self.margin)
        how.begin((self.candidates + 1) * on.each + (self.keep + 1) * self._each(unseen))
        today = self._today(how, known, unseen)
        before = judged(rows_of(today, 0, on.each), on.each, self.aims, holds, self.margin)
        front = several_aims(
            on.judge,
            family.varied.dimensions,
            evaluations=self.candidates,
            start=point_of_own(family.varied),
            seed=self.seed,
            seconds=self.seconds,
            most=self.keep,
        )
        table = on.rows(front.points, unseen) if len(front.points) else None
        return Tuned(
            aims=self.aims,
            holds=self.holds,
            confidence=self.confidence,
            seed=self.seed,
            base=self.described(),
            front=front,
            gains=self._chosen(family, front),
            before=before.aims[0],
            today=rows_of(today, on.each, None),
            held_out=table,
            **evaluated.collected(),
        )

    def _cases(self, family: Family) -> tuple[Values, Values]:
        """Those that candidates are judged on, and others."""
        space = family.uncertain
        if not space.sets:
            return {}, {}
        drawn = space.values(points(self.seed, 0, self.cases + self.held_out, space.dimensions))
        return (
            {path: array[: self.cases] for path, array in drawn.items()},
            {path: array[self.cases :] for path, array in drawn.items()},
        )

    @staticmethod
    def _each(cases: Values) -> int:
        return len(next(iter(cases.values()))) if cases else 1

    def _today(self, how: How, known: Values, unseen: Values) -> Columns:
        """The scenario as it is, on all cases."""
        family = self.family()
        runner = self.runner(family, replace(how, out=None if how.out is None else how.out / "today"))
        both = {path: np.concatenate([known[path], unseen[path]]) for path in known}
        # Without anything uncertain one run is both.
        columns = runner.rows(0, both) if both else runner.rows(0, {})
        if runner.store is not None:
            runner.store.finish(len(columns["row"]))
        return columns if both else {name: np.concatenate([array, array]) for name, array in columns.items()}

    def _chosen(self, family: Family, front: Front) -> list[dict[str, Any]]:
        values = family.varied.values(np.clip(front.points, 0.0, BELOW_ONE)) if len(front.points) else {}
        return [as_changes({path: array[k] for path, array in values.items()}) for k in range(len(front.points))]
