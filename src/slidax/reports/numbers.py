"""Numbers as a person reads them: 1.376, and 4.92 × 10⁻¹¹ rather than 4.92e-11."""

from __future__ import annotations

import math
import re

from markupsafe import Markup, escape

POWER_OF_TEN = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?)e([+-]?\d+)(?![\w.])")
SUBSCRIPT = re.compile(r"(?<!\w)(\w)_(\w+)")
MINUS = re.compile(r"(?<![\w.\-])-(?=\d)")


def significant(number: float | None, digits: int = 4) -> str:
    """The number in plain text, with so many significant digits; "–" for None and what is not finite.

    - `number`: any number.
    - `digits`: how many digits count.
    """
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
    """The text as HTML, with powers of ten raised, minus signs long, `T_max` with its index below; code in backticks.

    - `text`: plain text; what HTML would take for itself is escaped. Markup passes unchanged.
    """
    if isinstance(text, Markup):
        return text
    # Every other piece is what a reader would type.
    pieces = str(escape(text)).split("`")
    if len(pieces) % 2 == 0:
        return Markup(_set("`".join(pieces)))
    return Markup("".join(f"<code>{one}</code>" if k % 2 else _set(one) for k, one in enumerate(pieces)))


def _set(safe: str) -> str:
    safe = SUBSCRIPT.sub(r"\1<sub>\2</sub>", POWER_OF_TEN.sub(_raised, safe)).replace("N m", "N\u00a0m")
    return MINUS.sub("−", safe)


def _raised(match: re.Match[str]) -> str:
    mantissa, exponent = match.groups()
    power = f"10<sup>{int(exponent)}</sup>".replace("-", "−")
    return power if mantissa == "1" else f"{mantissa}\u00a0×\u00a0{power}"
