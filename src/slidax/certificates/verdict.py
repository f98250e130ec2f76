"""What a certificate says: whether a promise holds, by how much, and under which assumptions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from slidax.diagnosis import Remedy

Status = Literal["proved", "tested", "assumed", "fails"]
"""Of an assumption: `proved` follows from the definitions for the whole set, up to floating-point rounding, and the
number that is used is the one that was proved; `tested` was computed for finitely many members, times or cases, which
the text names; `assumed`: nothing was done for it; `fails`: tested, and not so."""

Grade = Literal["A", "B", "C"]
"""Of a verdict that holds: `A` all lines are proved, `B` some are, the others are tested or assumed, `C` none is."""


OVER_TIME = ("times", "error_over_time")
"""Bounds that a figure shows: times [N], s, and what |e| stays below then [N n], rad or m."""


@dataclass(frozen=True)
class Assumption:
    """One thing that a promise stands on.

    - `text`: a sentence that says what, and, if it was tested, in which cases.
    - `status`: how much is known of it.
    - `value`: the number that was found, if there is one.
    """

    text: str
    status: Status
    value: float | None = None


@dataclass(frozen=True)
class Verdict:
    """One certificate's answer; never raised.

    - `name`: of the certificate, the same for each scenario.
    - `title`: the promise in a few words, for a table.
    - `holds`: whether the promise stands; None where the certificate does not apply, which the statement explains.
    - `margin`: by how much, as a share of what is allowed: positive if it holds; None where there is no number.
    - `bound`: the numbers of the bound by name, scalars or one per joint, in SI.
    - `assumptions`: what it stands on.
    - `statement`: a sentence that says with units what is certain, by which equation.
    - `remedies`: the smallest changes that would make it hold, the best first; empty if it holds.
    - `since`: time from which it holds [s]; None for the whole run, or if it does not hold.
    """

    name: str
    title: str
    holds: bool | None
    margin: float | None
    bound: Mapping[str, Any]
    assumptions: Sequence[Assumption]
    statement: str
    remedies: Sequence[Remedy] = field(default=())
    since: float | None = None

    def __post_init__(self) -> None:
        if self.holds and any(one.status == "fails" for one in self.assumptions):
            raise AssertionError(f"the certificate `{self.name}` stands on an assumption that fails")

    @property
    def answer(self) -> str:
        """`yes`, `no`, `from 0.5 s` where it holds from a time on, or `-` where it does not apply."""
        if self.holds and self.since is not None:
            return f"from {self.since:.3g} s"
        return "-" if self.holds is None else "yes" if self.holds else "no"

    @property
    def grade(self) -> Grade | None:
        """How much of what it stands on is proved; None unless it holds."""
        if not self.holds:
            return None
        proved = [one.status == "proved" for one in self.assumptions]
        return "C" if not any(proved) else "A" if all(proved) else "B"

    @property
    def stands_on(self) -> str:
        """The number of lines of each status, "2 proved, 3 tested, 1 assumed"."""
        statuses = [one.status for one in self.assumptions]
        return ", ".join(f"{statuses.count(one)} {one}" for one in get_args(Status) if one in statuses)

    @property
    def bound_in_words(self) -> list[str]:
        """The numbers of the bound, "error 1.2e-05", the largest of all joints; what is given over time is left out."""
        words = []
        for name, value in self.bound.items():
            if name in OVER_TIME:
                continue
            numbers = _plain(value)
            flat = numbers if isinstance(numbers, list) else [numbers]
            if flat and all(isinstance(one, int | float) for one in flat):
                words.append(f"{name.replace('_', ' ')} {max(flat):.3g}")
        return words

    def as_json(self) -> dict[str, Any]:
        """As `slidax certify --json` prints it; what is not finite is None."""
        return {
            "name": self.name,
            "holds": self.holds,
            "since": _plain(self.since),
            "grade": self.grade,
            "margin": _plain(self.margin),
            "bound": {name: _plain(value) for name, value in self.bound.items()},
            "assumptions": [
                {"text": one.text, "status": one.status, "value": _plain(one.value)} for one in self.assumptions
            ],
            "statement": self.statement,
            "remedy": [{"words": one.words, "set": dict(one.changes)} for one in self.remedies],
        }


def _plain(value: Any) -> Any:
    """Numbers and arrays as JSON has them."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return _plain(value.tolist()) if hasattr(value, "tolist") else [_plain(one) for one in value]
