"""Formulas as MathML, which browsers draw by themselves: no script, no fonts, no network.

It runs in the environment of the site's builder: `python formulas.py FOLDER`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from latex2mathml.converter import convert

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"\$`([^`\n]+)`\$")


def with_mathml(text: str) -> str:
    """A page with its formulas drawn: blocks of the language `math`, and what stands between $` and `$.

    - `text`: of the page.
    """
    def block(match: re.Match[str]) -> str:
        lines = [line for line in match[1].split("\n\n") if line.strip()]
        drawn = "".join(convert(line.strip(), display="block") for line in lines)
        return f'<div class="formula">{drawn}</div>'

    return INLINE.sub(lambda match: convert(match[1]), BLOCK.sub(block, text))


def main() -> None:
    """Draws the formulas of all pages of a folder."""
    for path in sorted(Path(sys.argv[1]).rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if BLOCK.search(text) or INLINE.search(text):
            path.write_text(with_mathml(text), encoding="utf-8")


if __name__ == "__main__":
    main()
