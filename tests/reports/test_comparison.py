"""The report of several schemes: who stands out, and what is said of a run that came to a bad end."""

from __future__ import annotations

import json
import re
from pathlib import Path

import equinox as eqx
import pytest

from slidax import metrics, scenarios
from slidax._errors import DefinitionError
from slidax.reports import results, standings, write_comparison
from slidax.scenarios import Scenario
from slidax.simulation import Run

Pairs = dict[str, tuple[Scenario, Run]]


def simulated(name: str, **changes: object) -> tuple[Scenario, Run]:
    scenario = scenarios.load("example-4.1", {"scheme.name": name, "simulation.t1": 1.0, **changes})
    return scenario, scenario.simulate(progress=False)


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    good = {name: simulated(name) for name in ("cftsmppc", "ftsmc", "gravity_pd")}
    return good | {"hasty": simulated("cftsmppc", **{"scheme.performance.deadline": 0.05})}


@pytest.fixture(scope="module")
def page(pairs: Pairs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_comparison(pairs, tmp_path_factory.mktemp("comparison") / "new", command="slidax compare x > y")


def test_the_least_of_a_row_is_best_and_a_run_with_a_bad_end_is_never(pairs: Pairs) -> None:
    assert not pairs["hasty"][1].outcome.ok
    rows = {(row.metric, row.joint): row for row in standings(pairs)}
    for metric in ("peak_torque", "eci", "aice", "steady_error"):
        for joint in (1, 2):
            row = rows[metric, joint]
            least = min(value for name, value in row.values.items() if name != "hasty" and value is not None)
            assert {name for name, value in row.values.items() if value == least} - {"hasty"} == row.best
    assert all("hasty" not in row.best for row in rows.values())
    assert not rows["envelope_margin", 1].best
    assert rows["peak_torque", 1].values["ftsmc"] == metrics.peak_torque(pairs["ftsmc"][1])[0]
    assert rows["settling_time.1e-8", 1].values["gravity_pd"] is None


def test_nobody_stands_out_alone(pairs: Pairs) -> None:
    assert not any(row.best for row in standings({"cftsmppc": pairs["cftsmppc"]}))


def test_the_page_stands_alone_with_its_figures(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r"https?://|\ssrc=|<link|<script", text)
    names = {"tracking-errors", "velocity-errors", "torques", "tip-paths", "iae", "eci", "aice"}
    assert {path.stem for path in (page.parent / "figures").glob("*.svg")} == names
    assert text.count("<figure") == len(names)
    assert "slidax compare x &gt; y" in text
    assert "IAE. IAE" not in re.sub("<[^>]*>", "", text)


def test_the_page_shows_the_best_in_bold_and_the_bad_end(page: Path, pairs: Pairs) -> None:
    text = page.read_text(encoding="utf-8")
    row = next(row for row in standings(pairs) if row.metric == "peak_torque")
    (best,) = row.best
    assert f"<b>{row.values[best]:.2f}</b>" in text
    assert pairs["hasty"][1].outcome.message.split(" (")[0] in text


def test_the_results_are_json_without_what_json_does_not_know(page: Path, pairs: Pairs) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads((page.parent / "results.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert list(found["schemes"]) == list(pairs)
    assert found["schemes"]["hasty"]["outcome"] != "ok"
    assert found["schemes"]["hasty"]["stopped"]["joint"] in (1, 2)
    assert found["schemes"]["ftsmc"]["metrics"]["aice"] == metrics.aice(pairs["ftsmc"][1]).tolist()
    assert all(len(names) == 2 for names in found["best"].values())


def test_values_that_are_not_finite_become_null(pairs: Pairs) -> None:
    scenario, run = pairs["ftsmc"]
    wild = eqx.tree_at(lambda r: r.tally.eci, run, run.tally.eci * float("inf"))
    found = results({"ftsmc": (scenario, wild), "cftsmppc": pairs["cftsmppc"]})
    assert found["schemes"]["ftsmc"]["metrics"]["eci"] == [None, None]
    assert found["best"]["eci"] == [["cftsmppc"], ["cftsmppc"]]


def test_many_schemes_take_several_tables_and_runs_without_a_log_no_figures(pairs: Pairs, tmp_path: Path) -> None:
    scenario, run = pairs["cftsmppc"]
    many = {f"scheme {i}": (scenario, eqx.tree_at(lambda r: r.log, run, None)) for i in range(14)}
    text = write_comparison(many, tmp_path).read_text(encoding="utf-8")
    assert "<figure" not in text
    assert text.count("<th>Metric</th>") == 3


def test_what_cannot_be_compared_is_refused(pairs: Pairs, tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match="at least one"):
        write_comparison({}, tmp_path)
    other = scenarios.load("example-4.2", {"simulation.t1": 0.1})
    with pytest.raises(DefinitionError, match="same arm"):
        write_comparison({"one": pairs["ftsmc"], "two": (other, other.simulate(progress=False))}, tmp_path)
