"""Schemes, or gains, on the same cases."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator

from slidax._errors import DefinitionError, located, nearest, plain
from slidax.scenarios.base import said
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered_description
from slidax.scenarios.uncertainty import AbstractSet
from slidax.scenarios.uncertainty.sets import Between, Inside

from .compared import Compared, can_be_asked
from .points import points
from .predicate import ENVELOPE, Predicate
from .runner import PartDone
from .study import AbstractStudy, How
from .table import Columns

OF = ("steady_error", "max_torque_step", "peak_torque")


class Compare(AbstractStudy):
    """Runs several schemes on the same cases; the first is the one that the others are compared with."""

    in_parts: ClassVar[bool] = True
    study: Literal["compare"]
    schemes: Annotated[dict[str, dict[str, Any]], Field(min_length=2, max_length=50)]
    """Values of the scenario by path, as `--set` has them, by a name for each; `{}` is the scenario as it is."""
    runs: int = said("cases for each scheme", "", "[1, 1e9]", default=500)
    of: Annotated[tuple[str, ...], Field(min_length=1)] = OF
    """Metrics that are compared."""
    holds: Annotated[tuple[str, ...], Field(min_length=1)] = (ENVELOPE,)
    """Properties whose shares are compared: `envelope`, or a metric, a sign and a number."""
    confidence: float = said("of the intervals", "", "(0, 1)", default=0.95)

    @field_validator("schemes")
    @classmethod
    def _names_are_names_of_folders(cls, value: dict[str, Any]) -> dict[str, Any]:
        for name in value:
            if not name or not name.replace("-", "").replace("_", "").replace(".", "").isalnum() or name[0] == ".":
                raise ValueError(f"`{plain(name)}` must be letters, digits, `-`, `_` and `.`")
        return value

    def run(self, how: How) -> Compared:
        """The differences.

        - `how`: where, and what is told on the way.
        """
        holds = [Predicate(text) for text in self.holds]
        families = self._families()
        first = next(iter(families.values()))
        self.require(bool(first.space.sets), "uncertainty", "is empty, so that all cases would be the same")
        cases = first.space.values(points(self.seed, 0, self.runs, first.space.dimensions))
        how.begin(self.runs * len(families))
        tables: dict[str, Columns] = {}
        computed, seconds, missing = 0, 0.0, 0
        for name, family in families.items():
            own = how if how.out is None else replace(how, out=how.out / name)
            runner = self.runner(family, own)
            try:
                tables[name] = runner.rows(0, cases)
            except PartDone as part:
                missing += part.missing
                continue
            computed, seconds = computed + runner.computed, seconds + runner.seconds
            if runner.store is not None:
                runner.store.finish(self.runs)
        if missing:
            raise PartDone(missing, self.runs * len(families))
        for item in self.of:
            if item not in tables[next(iter(tables))]:
                raise DefinitionError(
                    f"there is no metric `{plain(item)}`; {nearest(item, tables[next(iter(tables))])}", where="of"
                )
        for predicate in holds:
            for table in tables.values():
                if can_be_asked(predicate.text, table):
                    predicate.holds(table)
        return Compared(
            of=self.of,
            holds=self.holds,
            confidence=self.confidence,
            seed=self.seed,
            family=first,
            tables=tables,
            path=how.out,
            computed=computed,
            seconds=seconds,
        )

    def _families(self) -> dict[str, Family]:
        """One for each scheme, with the same sets: a start inside the envelope is one inside that of the first."""
        base = self.described()
        sets = self.sets(base)
        result: dict[str, Family] = {}
        for name, changes in self.schemes.items():
            with located(f"schemes.{name}"):
                own = altered_description(base, changes) if changes else base
                result[name] = Family.of(own, sets)
            if len(result) == 1:
                sets = dict(_box(path, item, result[name]) for path, item in sets.items())
        return result


def _box(path: str, item: AbstractSet, family: Family) -> tuple[str, AbstractSet]:
    """The set, in numbers where it depends on the scheme."""
    if not isinstance(item, Inside):
        return path, item
    path = path if path in family.space.leaves else "start.q"
    leaf = family.space.leaves[path]
    ends = [item.values(np.full((1, item.coordinates(leaf)), u), leaf)[0].tolist() for u in (0.0, 1.0)]
    return path, Between(between=ends, each=item.each)
