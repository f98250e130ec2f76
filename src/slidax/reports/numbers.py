"""Numbers for readers: 1.376, and 4.92 × 10⁻¹¹ instead of 4.92e-11."""

from __future__ import annotations

import math
import re

from markupsafe import Markup, escape

POWER_OF_TEN = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.])")
SUBSCRIPT = re.compile(r"(?<!\w)(\w)_(\w+)")
MINUS = re.compile(r"(?<![\w.\-])-(?=\d)")


def significant(number: float | None, digits: int = 4) -> str:
    """Format a `number` with `digits` significant digits as plain text; "–" for None and non-finite values."""
    if number is None or not math.isfinite(number):
        return "–"
    if number == 0:
        return "0"
    mantissa, exponent = f"{number:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -3 <= power < 4:
        return f"{float(f'{mantissa}e{power}'):.{max(0, digits - 1 - power)}f}"
    return f"{mantissa}e{power}"


def typeset(text: object) -> Markup:
    """Return a plain `text` as HTML: raised powers of ten, long minus signs, `T_max` with subscript, code in backticks.

    HTML in the text is escaped; Markup passes unchanged.
    """
    if isinstance(text, Markup):
        return text
    # Every other piece is what a reader would type.
    pieces = str(escape(text)).split("`")
    if len(pieces) % 2 == 0:
        return Markup(_set("`".join(pieces)))
    return Markup("".join(f"<code>{piece}</code>" if k % 2 else _set(piece) for k, piece in enumerate(pieces)))


def _set(safe: str) -> str:
    safe = SUBSCRIPT.sub(r"\1<sub>\2</sub>", POWER_OF_TEN.sub(_raised, safe)).replace("N m", "N\u00a0m")
    return MINUS.sub("−", safe)


def _raised(match: re.Match[str]) -> str:
    mantissa, exponent = match.groups()
    power = f"10<sup>{int(exponent)}</sup>".replace("-", "−")
    return power if mantissa == "1" else f"{mantissa}\u00a0×\u00a0{power}"
