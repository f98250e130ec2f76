"""Declare a parameter once: meaning, unit, range, default and source."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, cached_property
from types import CodeType
from typing import Any, get_args

import equinox as eqx
import numpy as np

from .errors import as_array, is_traced

INTERVAL = re.compile(r"([\[(])(.+),(.+)([\])])")
COMPARISON = re.compile(r"(>=|>|<=|<)(.+)")


@dataclass(frozen=True)
class End:
    """One end of a range: a number, or an expression over other parameters of the same part, such as `4 - 2 * gain`.

    - `open`: True if the end itself is not an allowed value.
    """

    text: str
    open: bool

    @cached_property
    def number(self) -> float | None:
        """The end as a number; None for an expression."""
        try:
            return float(Fraction(self.text)) if "/" in self.text else float(self.text)
        except ValueError:
            return None

    def value(self, part: object) -> Any:
        """Return the value of the end, one number or [n].

        - `part`: object with the values of other parameters in an expression.
        """
        number = self.number
        return number if number is not None else eval(self._code, {}, _Fields(part))

    def shown(self, part: object) -> str:
        """Return the end for a message, with its value if it is an expression.

        - `part`: as in `value`.
        """
        return self.text if self.number is not None else f"`{self.text}` = {np.asarray(self.value(part)).tolist()}"

    @cached_property
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

    Infinity is not allowed, unless the end has the form `inf]` or `[-inf`. `final` is another parameter of the part.
    """

    text: str = ""

    def __post_init__(self) -> None:
        assert not self.text or INTERVAL.fullmatch(self.text) or COMPARISON.fullmatch(self.text), self.text

    @cached_property
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
        """The range as it is written in tables: `text`, except "> 0, infinite for no limit" for `(0, inf]`."""
        return "> 0, infinite for no limit" if self.text == "(0, inf]" else self.text

    def holds(self, part: object, values: np.ndarray) -> np.ndarray:
        """Return a Boolean array: True for each value inside the range.

        An end may be an expression over other parameters, such as `4 - 2 * gain`. Its value is broadcast with `values`.

        - `part`: object with the values of those parameters.
        - `values`: values to check.
        """
        lower, upper = self.ends
        low, high = lower.value(part), upper.value(part)
        above = values > low if lower.open else values >= low
        return np.asarray(above & (values < high if upper.open else values <= high))

    def rule(self, part: object, unit: str = "") -> str:
        """Return the range as the end of a message: "must be > 0", "must be in (0, 1)".

        - `part`: object with the values of other parameters that the range names.
        - `unit`: unit of the parameter; empty if it depends on the kind of joint.
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


REQUIRED: Any = object()
"""Default of a parameter without a default."""

ANY = Range()

SHAPES = {
    "PerJoint": "one number or [n]",
    "Scalar": "one number",
    "Vector": "[n]",
    "Matrix": "[n n]",
    "State": "positions and velocities, each [n]",
}
"""Shape of each array type, in the words of a docstring."""

ARRAYS = {"...": "PerJoint", "": "Scalar", "n": "Vector", "n n": "Matrix"}
"""Array types by their dimensions."""

MATRIX = "one number, a diagonal [n] or a matrix [n n]"

_KEY = "slidax"


@dataclass(frozen=True)
class Parameter:
    """A parameter as its class declares it.

    - `meaning`: description with its symbol.
    - `unit`: empty for a pure number.
    - `range`: allowed values.
    - `why`: reason for the range, with its equation.
    - `default`: default value, or `REQUIRED`.
    - `source`: source of the default.
    - `shape`: "one number", "one number or [n]", "[3]", ...; empty for a field without numbers.
    - `annotation`: type of the field, as text.
    - `piece`: True for a field that is not numeric: another part, a name or a choice.
    """

    name: str
    meaning: str
    unit: str = ""
    range: Range = ANY
    why: str = ""
    default: Any = REQUIRED
    source: str = ""
    shape: str = ""
    annotation: str = ""
    piece: bool = False

    @property
    def required(self) -> bool:
        """True without a default."""
        return self.default is REQUIRED

    @property
    def limits(self) -> str:
        """Range and reason in a few words: "> 0 (eq. 40)"; empty for any number."""
        reason = self.why if self.why.startswith("(") or not self.why else f", {self.why}"
        separator = " " if reason.startswith("(") else ""
        return f"{self.range.words}{separator}{reason}".strip(" ,")

    def rule(self, part: object) -> str:
        """Return the range of a part's parameter as the end of a sentence: "must be > 0 (eq. 40)"."""
        separator = "" if not self.why else " " if self.why.startswith("(") else ", "
        return f"{self.range.rule(part, '' if ' or ' in self.unit else self.unit)}{separator}{self.why}"

    def bullet(self) -> str:
        """One line of a docstring: meaning, shape, unit, range, default."""
        within = f"in {self.range.text}" if self.range.words[:1] in ("(", "[") else self.range.words
        text = ", ".join(part for part in (self.meaning, self.shape, self.unit, within) if part)
        if not self.required and self.default is not None and not self.piece:
            text += f"; {_shown(self.default)} if not given"
        return f"- `{self.name}`: {text}."


def parameter(
    meaning: str,
    unit: str = "",
    range: str = "",
    why: str = "",
    *,
    default: Any = REQUIRED,
    source: str = "",
    matrix: bool = False,
    static: bool = False,
    converter: Any = as_array,
) -> Any:
    """Declare a numeric field of a part. The field is checked, documented, and a leaf of the part's pytree.

        k1: PerJoint = parameter("diagonal of K1", "rad/s or m/s", "> 0", "(eq. 40)")

    The annotation determines the shape: `Scalar` is one number, `PerJoint` one number for all joints or one per joint,
    `Vector` one number per joint, `Float[Array, "3"]` three numbers. The default None makes the field optional.

    - `meaning`: description with its symbol, in a few words.
    - `range`: as in `Range`; any finite number if empty.
    - `why`: reason for the range, as "so that ... (eq. 20)" or "(eq. 20)".
    - `source`: source of the default.
    - `matrix`: True if the value may also be a matrix.
    - `static`: True for a plain Python number on whose value compiled code depends (not a leaf of the pytree).
    - `converter`: function from the argument to the field's value; by default to a float array.
    """
    declared = Parameter("", meaning, unit, Range(range), why, default, source, MATRIX if matrix else "")
    if static and converter is as_array:
        converter = None
    if default is None and converter is not None:
        converter = _maybe(converter)
    how = {} if default is REQUIRED else {"default": default}
    if converter is not None:
        how["converter"] = converter
    return eqx.field(static=static, metadata={_KEY: declared}, **how)


def piece(meaning: str, *, default: Any = REQUIRED, default_factory: Any = REQUIRED, static: bool = False) -> Any:
    """Declare a field of a part that is not numeric: another part, a name, a choice.

    - `static`: True for a value that is no pytree, such as a name, on which compiled code depends.
    """
    declared = Parameter("", meaning, default=default, piece=True)
    how = {} if default is REQUIRED else {"default": default}
    if default_factory is not REQUIRED:
        how["default_factory"] = default_factory
        declared = replace(declared, default=default_factory)
    return eqx.field(static=static, metadata={_KEY: declared}, **how)


@cache
def parameters_of(part: type) -> tuple[Parameter, ...]:
    """Return the parameters of a part, in order; an undeclared field has only a name, a type and a default."""
    return tuple(declaration(field) for field in dataclasses.fields(part) if field.init)


def is_declared(field: dataclasses.Field[Any]) -> bool:
    """True if `parameter` or `piece` declares a dataclass field."""
    return _KEY in field.metadata


def declaration(field: dataclasses.Field[Any], annotation: str = "") -> Parameter:
    """Return a dataclass field's declaration with its name and type.

    - `annotation`: type of the field, if its class is not a dataclass yet.
    """
    written = _annotation(annotation or field.type)
    if _KEY not in field.metadata:
        default = REQUIRED if field.default is dataclasses.MISSING else field.default
        return Parameter(field.name, "", default=default, shape=_shape(written), annotation=written)
    known: Parameter = field.metadata[_KEY]
    return replace(known, name=field.name or known.name, annotation=written, shape=known.shape or _shape(written))


def _annotation(of: Any) -> str:
    """Return a field's type as text, from a string or from an evaluated annotation."""
    if isinstance(of, str):
        return of
    if type(None) in get_args(of):
        (needed,) = (each for each in get_args(of) if each is not type(None))
        return f"{_annotation(needed)} | None"
    dims = getattr(of, "dim_str", None)
    if dims is not None:
        return ARRAYS.get(dims.strip(), f'Float[Array, "{dims}"]')
    return getattr(of, "__name__", str(of))


def _shape(annotation: str) -> str:
    plain = annotation.removesuffix(" | None")
    if plain in SHAPES:
        return SHAPES[plain]
    array = re.fullmatch(r"(?:Float|Int|Bool)\[Array, ['\"](.*)['\"]\]", plain)
    if array is None:
        return "one number" if plain in ("float", "int") else ""
    dims = array.group(1).strip()
    return f"[{dims}]" if dims else "one number"


def _maybe(converter: Any) -> Any:
    return lambda value: None if value is None else converter(value)


def _shown(default: Any) -> str:
    return f"{default:g}" if isinstance(default, float) else "none" if default == () else str(default)
