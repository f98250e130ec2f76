"""Curves drawn with the characters of a terminal, eight dots to a character."""

from __future__ import annotations

import numpy as np
from rich.text import Text

ACROSS, DOWN = 2, 4
"""Dots of a character."""

BITS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Of a character in braille, by row and column of its dots."""

BRAILLE = 0x2800


class Dots:
    """A field of dots; what is drawn later lies over what was drawn before.

    - `columns`, `rows`: characters across and down.
    - `plain`: with the letters of ASCII alone, for terminals that have no others.
    """

    def __init__(self, columns: int, rows: int, *, plain: bool = False) -> None:
        self.columns, self.rows, self.plain = columns, rows, plain
        self._bits = np.zeros((rows, columns), dtype=int)
        self._styles = np.full((rows, columns), "", dtype=object)

    @property
    def across(self) -> int:
        """Dots side by side."""
        return ACROSS * self.columns

    @property
    def down(self) -> int:
        """Dots one over the other."""
        return DOWN * self.rows

    def stroke(self, x: int, low: float, high: float, style: str) -> None:
        """An upright stroke, cut off at the edges; at least one dot.

        - `x`: the column of dots, from 0 on the left.
        - `low`, `high`: its ends, from 0 at the bottom to 1 at the top.
        - `style`: as rich names it.
        """
        if high < 0.0 or low > 1.0:
            return
        last = self.down - 1
        bottom, top = (round(float(np.clip(end, 0.0, 1.0)) * last) for end in (low, high))
        for y in range(last - top, last - bottom + 1):
            row, column = y // DOWN, x // ACROSS
            self._bits[row, column] |= BITS[y % DOWN][x % ACROSS]
            self._styles[row, column] = style

    def lines(self) -> list[Text]:
        """The rows, from the top."""
        found = []
        for bits, styles in zip(self._bits, self._styles, strict=True):
            line = Text()
            for mark, style in zip(bits, styles, strict=True):
                line.append(self._character(int(mark)), style)
            found.append(line)
        return found

    def _character(self, bits: int) -> str:
        if not bits:
            return " "
        return ("*" if bits.bit_count() > 1 else ".") if self.plain else chr(BRAILLE + bits)
