"""The page with programs that only play back a log, and a browser to open it in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from slidax.export.web.playground import page_text

from .browser import Visit, browser
from .fixture import FAKE_LOOP, fake_playground


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    (folder / "index.html").write_text(page_text(fake_playground(), loop=FAKE_LOOP), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as found:
        yield found


@pytest.fixture
def visit(chromium: Any, site: Path) -> Iterator[Visit]:
    made = Visit(chromium, (site / "index.html").as_uri())
    yield made
    assert made.errors == []
    made.close()
