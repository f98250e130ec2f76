"""The one declaration of a parameter, and what can be read off it."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx

from slidax._errors import as_array

from .range import Range

REQUIRED: Any = object()
"""The default of a parameter that has none."""

ANY = Range()

SHAPES = {
    "PerJoint": "one number or [n]",
    "Scalar": "one number",
    "Vector": "[n]",
    "Matrix": "[n n]",
    "State": "positions and velocities, each [n]",
}
"""What the types of arrays are called in a docstring."""

MATRIX = "one number, a diagonal [n] or a matrix [n n]"

_KEY = "slidax"


@dataclass(frozen=True)
class Parameter:
    """A parameter as its class declares it.

    - `name`: of the field.
    - `meaning`: what it is, with its symbol.
    - `unit`: of one of its numbers; empty for a pure number.
    - `range`: what values it may have.
    - `why`: the reason of the range, with its equation.
    - `default`: its value if none is given; `REQUIRED` if it must be.
    - `source`: where the default comes from.
    - `shape`: how many numbers: "one number", "one number or [n]", "[3]", ...; empty for what is not a number.
    - `annotation`: the type of the field, as it is written.
    - `piece`: whether it is another part, or anything else but numbers.
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
        """Whether it must be given."""
        return self.default is REQUIRED

    @property
    def limits(self) -> str:
        """Range and reason in a few words: "> 0 (eq. 40)"; empty for any number."""
        reason = self.why if self.why.startswith("(") or not self.why else f", {self.why}"
        separator = " " if reason.startswith("(") else ""
        return f"{self.range.words}{separator}{reason}".strip(" ,")

    def rule(self, part: object) -> str:
        """What must hold, as a sentence's end.

        - `part`: whose parameter it is.
        """
        separator = "" if not self.why else " " if self.why.startswith("(") else ", "
        return f"{self.range.rule(part, '' if ' or ' in self.unit else self.unit)}{separator}{self.why}"

    def bullet(self) -> str:
        """One line of a docstring: meaning, shape, unit, range, default."""
        within = f"in {self.range.text}" if self.range.words[:1] in ("(", "[") else self.range.words
        said = [self.meaning, self.shape, self.unit, within]
        text = ", ".join(part for part in said if part)
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
    """A field of a part: numbers that are checked, documented, and leaves of the tree.

        k1: PerJoint = parameter("diagonal of K1", "rad/s or m/s", "> 0", "(eq. 40)")

    The annotation says how many: `Scalar` one, `PerJoint` one or one for each joint, `Vector` one for each joint,
    `Float[Array, "3"]` three. With the default None it may be left out.

    - `meaning`: what it is, with its symbol, in a few words.
    - `unit`: of one of its numbers.
    - `range`: as in `Range`; any finite number if empty.
    - `why`: the reason of the range, as "so that ... (eq. 20)" or "(eq. 20)".
    - `default`: its value if none is given.
    - `source`: where the default comes from.
    - `matrix`: whether it may be a matrix, too.
    - `static`: whether compiled code depends on it; for a plain number of Python.
    - `converter`: from what is given to the field's type; by default anything like numbers to a float array.
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
    """A field of a part that is no number: another part, a name, a choice.

    - `meaning`: what it is.
    - `default`, `default_factory`: what it is if none is given.
    - `static`: whether compiled code depends on it.
    """
    declared = Parameter("", meaning, default=default, piece=True)
    how = {} if default is REQUIRED else {"default": default}
    if default_factory is not REQUIRED:
        how["default_factory"] = default_factory
        declared = replace(declared, default=default_factory)
    return eqx.field(static=static, metadata={_KEY: declared}, **how)


def parameters_of(part: type) -> list[Parameter]:
    """The parameters of a part, in order; a field without a declaration is known by its name, type and default alone.

    - `part`: its class.
    """
    return [declared(field) for field in dataclasses.fields(part) if field.init]


def is_declared(field: dataclasses.Field[Any]) -> bool:
    """Whether a field is declared by `parameter` or `piece`.

    - `field`: of a dataclass.
    """
    return _KEY in field.metadata


def declared(field: dataclasses.Field[Any], annotation: str = "") -> Parameter:
    """What a field's declaration says, completed by its name and type.

    - `field`: of a dataclass.
    - `annotation`: its type as it is written, where the field does not know it yet.
    """
    written = str(annotation or field.type)
    if _KEY not in field.metadata:
        default = REQUIRED if field.default is dataclasses.MISSING else field.default
        return Parameter(field.name, "", default=default, shape=_shape(written), annotation=written)
    said: Parameter = field.metadata[_KEY]
    return replace(said, name=field.name or said.name, annotation=written, shape=said.shape or _shape(written))


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
