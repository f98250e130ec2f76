import re
from pathlib import Path

import pytest

import slidax.export.web
from tests.report.figures.test_figures import contrast

CSS = (Path(slidax.export.web.__file__).parent / "page" / "style.css").read_text(encoding="utf-8")
COLOURS = [
    dict(re.findall(r"--(\w+): (#\w{6})\b", block)) for block in re.findall(r":root[^{]*\{(.*?)\}", CSS, re.DOTALL)
]
THEMES = [COLOURS[0], *({**COLOURS[0], **dark} for dark in COLOURS[1:])]


@pytest.mark.parametrize("theme", THEMES, ids=["light", "dark", "auto"])
def test_text_fields_and_curves_of_the_page_contrast_with_their_ground(theme):
    for ground in ("ground", "panel"):
        for ink in ("ink", "soft", "good", "bad", "warn", "a"):
            assert contrast(theme[ink], theme[ground]) >= 4.5, (ink, ground)
        for line in ("field", "b", "limit", "edge"):
            assert contrast(theme[line], theme[ground]) >= 3.0, (line, ground)
