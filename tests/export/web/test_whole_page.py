"""A page as `slidax export web` writes it, in a browser: what is moved there is what `slidax run` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.export.web import write_playground
from slidax.export.web.settings import ProgramChoice
from slidax.scenarios import load

from .browser import Visit, served
from .test_loop import made

CLOSE = 1e-12
"""Of the largest value of a joint's signal."""

PERIODS = ProgramChoice("simulation.period", "period", "s", (1e-3, 2e-3))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    manifest = made("example-4.1-1khz", (), (PERIODS,), simulation__t1=2.0)
    return write_playground(manifest, tmp_path_factory.mktemp("site"))


@pytest.mark.full
def test_through_sliders_and_download_it_is_the_run_of_python(chromium: Any, site: Path, tmp_path: Path) -> None:
    with served(site.parent) as (address, asked):
        visit = Visit(chromium, f"{address}/{site.name}")
        visit.page.evaluate("document.querySelectorAll('#tunables .group').forEach(one => { one.open = true; })")
        for path, value in (
            ("scheme.surface.k1", "0.37"),
            ("robot.plant.inertias", None),
            ("disturbance.scale", "1.3"),
        ):
            place = f"[data-path='{path}']"
            box = visit.page.locator(f"{place} > .slider .box" if value else f"{place} .joint .box >> nth=1")
            box.fill(value or "5.5")
            box.press("Enter")
            visit.settle()
        visit.page.select_option("#tunables .choice select", "1")
        visit.settle()
        state = visit.state()
        assert state["values"] == {
            "scheme.surface.k1": 0.37,
            "robot.plant.inertias": [5, 5.5],
            "disturbance.scale": 1.3,
        }
        found = visit.page.evaluate(
            "(() => { const { t, signals, outcome } = slidaxPage.result('A');"
            " return { t: [...t], q: [...signals.q], e: [...signals.e], tau: [...signals.tau], outcome }; })()"
        )
        file = tmp_path / "moved.yaml"
        file.write_bytes(Path(visit.saved("#scenario").path()).read_bytes())
        assert visit.errors == []
        assert asked == [f"/{site.name}"]
        visit.close()
    run = load(file).simulate()
    log = run.log
    rows = np.searchsorted(log.t, np.array(found["t"]) - 1e-9)
    assert found["outcome"]["message"] == run.outcome.message
    assert len(rows) > 900
    for name, array in {"q": log.state.q, "e": log.e, "tau": log.tau}.items():
        theirs = np.asarray(array)
        ours = np.reshape(found[name], (len(rows), -1))
        worst = np.max(np.abs(ours - theirs[rows]) / np.max(np.abs(theirs), axis=0))
        assert worst < CLOSE, f"{name}: {worst}"
