"""Plain verdicts on printed values, by a rule that is stated once and holds for all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from slidax.reports import significant

REPRODUCED = 0.05
"""A computed value within this fraction of the printed one reproduces it."""

CLOSE = 0.20
"""Within this fraction it is close; beyond, it differs."""

Kind = Literal["reproduced", "close", "differs", "unchecked"]
KINDS: tuple[Kind, ...] = ("reproduced", "close", "differs", "unchecked")


@dataclass(frozen=True)
class Verdict:
    """The result of a comparison.

    - `kind`: "reproduced", "close", "differs" or "unchecked".
    - `text`: the verdict in words.
    """

    kind: Kind
    text: str


def compare(printed: float, computed: float | None, absent: Verdict | None = None) -> Verdict:
    """The verdict on a printed number: reproduced within 5 %, close within 20 %, else it differs by a factor.

    - `printed`: > 0.
    - `computed`: the same quantity; None or not finite if there is none.
    - `absent`: the verdict if there is none.
    """
    if computed is None or not math.isfinite(computed):
        return absent or unchecked("the run has no such value")
    deviation = abs(computed / printed - 1.0)
    if deviation <= REPRODUCED + 1e-12:
        return Verdict("reproduced", f"reproduced within {_percent(deviation)}")
    if deviation <= CLOSE + 1e-12:
        return Verdict("close", f"close: {_percent(deviation)} {'above' if computed > printed else 'below'}")
    return Verdict("differs", f"differs: {significant(computed / printed, 2)} times printed")


def below(limit: float, computed: float | None) -> Verdict:
    """The verdict on a printed limit: reproduced if the computed value is below it.

    - `limit`: > 0.
    - `computed`: what must be below; None or not finite if there is none.
    """
    if computed is None or not math.isfinite(computed):
        return unchecked("the run has no such value")
    if computed < limit:
        return Verdict("reproduced", f"holds: {significant(computed, 2)} is below")
    return Verdict("differs", f"does not hold: {significant(computed / limit, 2)} times the limit")


def claim(holds: bool) -> Verdict:
    """The verdict on a statement that is true or not.

    - `holds`: whether it is.
    """
    return Verdict("reproduced", "holds") if holds else Verdict("differs", "does not hold")


def unchecked(why: str) -> Verdict:
    """The verdict where there is nothing to compare.

    - `why`: the reason.
    """
    return Verdict("unchecked", f"cannot be checked: {why}")


def incomparable(why: str) -> Verdict:
    """The verdict where the computed number is an accident of the computation.

    - `why`: the reason.
    """
    return Verdict("unchecked", f"not compared: {why}")


def _percent(fraction: float) -> str:
    """Rounded up to a tenth, so that "within" stays true."""
    return f"{max(0.1, math.ceil(fraction * 1000 - 1e-9) / 10):.1f} %"
