"""Declared units, as FMU importers write and check them."""

from __future__ import annotations

import re
from dataclasses import dataclass

BASE: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
}
"""Symbols by their SI base units."""

SUPERSCRIPTS = str.maketrans("²³", "23")
TOKEN = re.compile(r"\s*([()/]|[A-Za-z1]+|\^?\d)\s*")
COUNTS = ("periods", "samples", "sampling periods")


@dataclass(frozen=True)
class Unit:
    """A unit.

    - `name`: with a dot for a product and plain exponents, such as `N.m` and `kg.m2`.
    - `base`: exponents of SI base units, with `rad`, in order of appearance.
    """

    name: str
    base: tuple[tuple[str, int], ...]


def unit(declared: str, *, revolute: bool | None = True) -> Unit | None:
    """Parse a declared unit, such as `kg m²` or `rad/s or m/s`; None for a pure number, a count, or no unit.

    - `revolute`: True if the number belongs to a revolute joint; None where joints of both kinds share it.
    """
    text = declared.strip()
    if not text or text == "1" or text in COUNTS or "," in text:
        return None
    kinds = text.split(" or ")
    if len(kinds) == 2:
        if revolute is None:
            return None
        text = kinds[0 if revolute else 1]
    plain = text.translate(SUPERSCRIPTS).replace("^2", "2").replace("^3", "3")
    tokens = TOKEN.findall(plain)
    if "".join(tokens) != plain.replace(" ", ""):
        return None
    base = _product(tokens)
    return Unit(re.sub(r"\s+", ".", plain), tuple((name, power) for name, power in base.items() if power))


def _product(tokens: list[str]) -> dict[str, int]:
    """Exponents of a product up to its closing parenthesis."""
    exponents: dict[str, int] = {}
    divided = False
    while tokens:
        token = tokens.pop(0)
        if token == ")":
            break
        if token == "/":
            divided = True
            continue
        factor = _product(tokens) if token == "(" else dict(BASE[token])
        power = int(tokens.pop(0).lstrip("^")) if tokens and tokens[0].lstrip("^") in ("2", "3") else 1
        for name, exponent in factor.items():
            exponents[name] = exponents.get(name, 0) + power * exponent * (-1 if divided else 1)
        divided = False
    return exponents
