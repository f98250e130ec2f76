"""Formulas as MathML, which browsers draw by themselves: no script, no fonts, no network.

It runs in the environment of the site's builder: `python formulas.py FOLDER`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from latex2mathml.converter import convert

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TAG = re.compile(r"\\tag\{([^}]*)\}")
INLINE = re.compile(r"\$`([^`\n]+)`\$")


def with_mathml(text: str) -> str:
    """A page with its formulas drawn: blocks of the language `math`, and what stands between $` and `$.

    - `text`: of the page.
    """

    def block(match: re.Match[str]) -> str:
        number = TAG.search(match[1])
        drawn = convert(TAG.sub("", match[1]).strip(), display="block")
        name = f"Formula ({number[1]})" if number else "Formula"
        shown = f"<span>({number[1]})</span>" if number else ""
        # A wide one scrolls, and so has to be reached by keys.
        return f'<div class="formula" tabindex="0" role="group" aria-label="{name}">{drawn}{shown}</div>'

    # In a span, since a line that begins with <math> would end the paragraph.
    return INLINE.sub(lambda match: f"<span>{convert(match[1])}</span>", BLOCK.sub(block, text))


def main() -> None:
    """Draws the formulas of all pages of a folder."""
    for path in sorted(Path(sys.argv[1]).rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if BLOCK.search(text) or INLINE.search(text):
            path.write_text(with_mathml(text), encoding="utf-8")


if __name__ == "__main__":
    main()
