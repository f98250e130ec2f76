import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from slidax.export.golden_samples import record_closed_loop
from slidax.export.guarded_step import guarded_law
from slidax.export.web import settings, write_playground
from slidax.export.web.playground import playground
from slidax.export.web.settings import settings_of
from slidax.scenarios import alter, load
from tests.cli.commands import in_process
from tests.export.exported import COMPILERS, STRICT, Exported, needs_a_compiler, run

from .browser import Visit, typed

pytestmark = [pytest.mark.full, needs_a_compiler]

CLOSE = 1e-12
"""Of the largest value of a joint's signal."""

MOVED = {
    "scheme.surface.k1": "0.37",
    "scheme.surface.q": "1.31",
    "scheme.transformation.performance.final": "0.003",
    "scheme.transformation.overshoot": "0.4",
    "scheme.bound.b0": "10.5",
    "scheme.sampled_data.recovery.deadline": "0.2",
    "disturbance.scale": "1.3",
}


@pytest.fixture(scope="module")
def moved(chromium, tmp_path_factory):
    folder = tmp_path_factory.mktemp("moved")
    # Without limits the drives deliver what the law commands.
    described = load("example-4.1-1khz", {"simulation.t1": 2.0, "actuator": {}}).description
    with pytest.MonkeyPatch.context() as patch:
        # The certificates take long and are not needed here.
        patch.setattr(settings, "certificates_of", lambda scenario, paths: [])
        manifest = playground("test", settings_of(described, "arm"), {"arm": "Arm"})
    visit = Visit(chromium, write_playground(manifest, folder).as_uri())
    for path, value in MOVED.items():
        typed(visit, f"[data-path='{path}']", value)
    assert set(visit.state()["values"]) == set(MOVED)
    shown = visit.page.evaluate(
        "(() => { const { t, signals } = slidaxPage.result('A');"
        " return { t: [...t], q: [...signals.q], tau: [...signals.tau] }; })()"
    )
    scenario = folder / "moved.yaml"
    scenario.write_bytes(Path(visit.saved("#scenario").path()).read_bytes())
    zipfile.ZipFile(visit.saved("#c").path()).extractall(folder)
    # The C law has one value for all joints: a value for a single joint is left out and reported.
    visit.page.click("[data-path='scheme.surface.k2'] .each summary")
    second = visit.page.locator("[data-path='scheme.surface.k2'] .joint .box").nth(1)
    second.fill("0.9")
    second.press("Enter")
    visit.settle()
    again = zipfile.ZipFile(visit.saved("#c").path())
    assert "  scheme.surface.k2\n" in again.read("READ-ME.txt").decode()
    assert again.read("law/slidax_law.c").decode() == (folder / "law" / "slidax_law.c").read_text(encoding="utf-8")
    assert visit.errors == []
    visit.close()
    return shown, scenario, folder


def assert_close(result, shown, width):
    theirs = np.reshape(shown, (-1, width))
    worst = np.max(np.abs(np.asarray(result) - theirs) / np.max(np.abs(theirs), axis=0))
    assert worst < CLOSE, worst


def test_slidax_run_of_the_downloaded_scenario_reproduces_the_run_on_the_page(moved, tmp_path):
    shown, scenario, _ = moved
    done = in_process("run", str(scenario), "--json", "--out", str(tmp_path / "report"), code=0)
    assert json.loads(done.stdout)["outcome"] == "ok"
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    table = parquet.read_table(tmp_path / "report" / "log.parquet").to_pydict()
    rows = np.searchsorted(np.array(table["t"]), np.array(shown["t"]) - 1e-9)
    assert len(rows) > 900
    for name in ("q", "tau"):
        columns = [np.array(table[f"{name}_{joint}"])[rows] for joint in (1, 2)]
        assert_close(np.stack(columns, axis=1), shown[name], 2)


def test_the_downloaded_c_law_gives_the_torques_that_the_page_shows(moved):
    shown, scenario, folder = moved
    assert "NOT" not in (folder / "READ-ME.txt").read_text(encoding="utf-8")
    loaded, law = load(scenario), folder / "law"
    # A user compiles the example, too.
    run(law, COMPILERS[0], *STRICT, "slidax_law.c", "slidax_law_scenario.c", "example.c", "-o", "example", "-lm")
    samples = record_closed_loop(loaded, guarded_law(loaded)).samples
    result = Exported(loaded, law, written=True).answers(samples)
    rows = np.searchsorted(np.asarray(samples.t), np.array(shown["t"]) - 1e-9)
    assert len(rows) > 900
    assert_close(result.command["tau"][rows], shown["tau"], 2)
    # The changed values matter: the unchanged law gives other torques.
    (folder / "given").mkdir()
    unchanged = Exported(alter(loaded, {path: as_given(path) for path in MOVED}), folder / "given").answers(samples)
    assert np.max(np.abs(unchanged.command["tau"][rows] - np.reshape(shown["tau"], (-1, 2)))) > 1e-3


def as_given(path):
    place = load("example-4.1-1khz").description
    for name in path.split("."):
        place = getattr(place, name)
    return place
