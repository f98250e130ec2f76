"""Range of a parameter, parsed from its text."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from types import CodeType
from typing import Any

import numpy as np

from slidax._errors import is_traced

INTERVAL = re.compile(r"([\[(])(.+),(.+)([\])])")
COMPARISON = re.compile(r"(>=|>|<=|<)(.+)")


@dataclass(frozen=True)
class End:
    """One end of a range: a number, or an expression over other parameters of the same part, such as `4 - 2 * gain`.

    - `open`: True if the end itself is outside.
    """

    text: str
    open: bool

    @property
    def number(self) -> float | None:
        """The end as a number; None for an expression."""
        try:
            return float(Fraction(self.text)) if "/" in self.text else float(self.text)
        except ValueError:
            return None

    def value(self, part: object) -> Any:
        """Return the end for a part with these parameters, a number or [n]."""
        number = self.number
        return number if number is not None else eval(self._code, {}, _Fields(part))

    def shown(self, part: object) -> str:
        """Return the end for a message, with its value if it is an expression."""
        return self.text if self.number is not None else f"`{self.text}` = {np.asarray(self.value(part)).tolist()}"

    @property
    def _code(self) -> CodeType:
        return compile(self.text, "<range>", "eval")


class _Fields(dict[str, Any]):
    def __init__(self, part: object) -> None:
        self._part = part

    def __missing__(self, name: str) -> Any:
        value = getattr(self._part, name)
        return value if is_traced(value) else np.asarray(value)


@dataclass(frozen=True)
class Range:
    """Allowed values of a parameter: `> 0`, `>= 0`, `(0, 1)`, `[0, 1]`, `(0, 1]`, `> final`; empty for any number.

    Infinity is outside, unless the end has the form `inf]` or `[-inf`.
    """

    text: str = ""

    def __post_init__(self) -> None:
        assert not self.text or INTERVAL.fullmatch(self.text) or COMPARISON.fullmatch(self.text), self.text

    @property
    def ends(self) -> tuple[End, End]:
        """The lower and the upper end."""
        if interval := INTERVAL.fullmatch(self.text):
            opening, lower, upper, closing = (group.strip() for group in interval.groups())
            return End(lower, opening == "("), End(upper, closing == ")")
        if comparison := COMPARISON.fullmatch(self.text):
            sign, end = comparison.group(1), End(comparison.group(2).strip(), "=" not in comparison.group(1))
            return (end, End("inf", True)) if sign.startswith(">") else (End("-inf", True), end)
        return End("-inf", True), End("inf", True)

    @property
    def words(self) -> str:
        """The range for a table: its text, but "> 0, infinite for no limit" for `(0, inf]`."""
        return "> 0, infinite for no limit" if self.text == "(0, inf]" else self.text

    def holds(self, part: object, values: np.ndarray) -> np.ndarray:
        """Return True for each value inside, broadcast against ends that are other parameters of the part."""
        lower, upper = self.ends
        low, high = lower.value(part), upper.value(part)
        above = values > low if lower.open else values >= low
        return np.asarray(above & (values < high if upper.open else values <= high))

    def rule(self, part: object, unit: str = "") -> str:
        """Return the range as a rule: "must be > 0", "must be in (0, 1)".

        - `part`: has the values of other parameters in the range.
        - `unit`: empty for a parameter with several units.
        """
        if not self.text:
            return "must be finite"
        lower, upper = self.ends
        if INTERVAL.fullmatch(self.text):
            opening, closing = "(" if lower.open else "[", ")" if upper.open else "]"
            if lower.number == 0.0 and upper.number == math.inf:
                return "must be > 0 (infinite for no limit)"
            if upper.number == math.inf:
                return f"must be {'>' if lower.open else '>='} {lower.shown(part)}{f' {unit}' if unit else ''}"
            return f"must be in {opening}{lower.shown(part)}, {upper.shown(part)}{closing}"
        sign = COMPARISON.fullmatch(self.text)
        assert sign is not None
        end = lower if sign.group(1).startswith(">") else upper
        return f"must be {sign.group(1)} {end.shown(part)}{f' {unit}' if unit else ''}"

    def schema(self) -> dict[str, float]:
        """Return the numeric ends as keywords of a JSON schema."""
        lower, upper = self.ends
        keywords: dict[str, float] = {}
        for end, opened, closed in (
            (lower, "exclusiveMinimum", "minimum"),
            (upper, "exclusiveMaximum", "maximum"),
        ):
            number = end.number
            if number is not None and math.isfinite(number):
                keywords[opened if end.open else closed] = number
        return keywords
