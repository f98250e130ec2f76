"""Formulas as MathML, which browsers draw by themselves: no script, no fonts, no network."""

from __future__ import annotations

import re

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"\$`([^`\n]+)`\$")


def with_mathml(text: str) -> str:
    """A page with its formulas drawn: blocks of the language `math`, and what stands between $` and `$.

    - `text`: of the page.
    """
    if not BLOCK.search(text) and not INLINE.search(text):
        return text
    from latex2mathml.converter import convert

    def block(match: re.Match[str]) -> str:
        lines = [line for line in match[1].split("\n\n") if line.strip()]
        drawn = "".join(convert(line.strip(), display="block") for line in lines)
        return f'<div class="formula">{drawn}</div>'

    return INLINE.sub(lambda match: convert(match[1]), BLOCK.sub(block, text))
