import sys

import pytest

pytest.importorskip("uvicorn", reason="the extra `studio` is not installed")
pytest.importorskip("playwright", reason="Playwright drives the browser")

from .clicking import CHROMIUM, visit

if CHROMIUM is None or not sys.platform.startswith("linux"):
    pytest.skip("there is no Chromium on this machine", allow_module_level=True)


@pytest.mark.full
def test_twenty_seconds_of_random_clicks_cause_no_error(tmp_path):
    outcome = visit(tmp_path, 20.0, seed=1)
    assert outcome.faults == [] and sum(outcome.actions.values()) > 20
