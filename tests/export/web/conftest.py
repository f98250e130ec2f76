import pytest

from slidax.export.web.playground import page_text

from .browser import Visit, browser
from .fixture import FAKE_LOOP, fake_playground


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    (folder / "index.html").write_text(page_text(fake_playground(), loop=FAKE_LOOP), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def chromium():
    with browser() as program:
        yield program


@pytest.fixture
def visit(chromium, site):
    page = Visit(chromium, (site / "index.html").as_uri())
    yield page
    assert page.errors == []
    page.close()
