import json
import re
from dataclasses import replace

import equinox as eqx
import pytest

from slidax import analysis, scenarios
from slidax.analysis.index_sums import INDEX_SUMS
from slidax.core.errors import DefinitionError
from slidax.report import Rival, results, standings, write_comparison
from slidax.report.comparison import comparison_verdict

JUDGE = scenarios.load("example-4.1", {"simulation.t1": 1.0})


def simulated(name, **changes):
    scenario = scenarios.load("example-4.1", {"scheme.name": name, "simulation.t1": 1.0, **changes})
    return Rival.simulated(scenario, JUDGE, logged=True)


@pytest.fixture(scope="module")
def rivals():
    good = {name: simulated(name) for name in ("cftsmppc", "ftsmc", "gravity_pd")}
    return good | {"hasty": simulated("cftsmppc", **{"scheme.performance.deadline": 0.05})}


@pytest.fixture(scope="module")
def page(rivals, tmp_path_factory):
    return write_comparison(
        rivals, tmp_path_factory.mktemp("comparison") / "new", also=INDEX_SUMS, command="slidax compare x > y"
    )


def test_the_least_value_is_best_and_never_that_of_a_failed_run(rivals):
    assert not rivals["hasty"].run.outcome.ok
    rows = {(row.metric.key, row.joint): row for row in standings(rivals, INDEX_SUMS)}
    for metric in ("peak_torque", "torque_energy", "torque_travel", "paper.iae", "steady_error"):
        for joint in ("joint 1", "joint 2"):
            row = rows[metric, joint]
            least = min(value for name, value in row.values.items() if name != "hasty" and value is not None)
            assert {name for name, value in row.values.items() if value == least} - {"hasty"} == row.best
    assert all("hasty" not in row.best for row in rows.values())
    assert not rows["envelope_margin", "joint 1"].best
    assert rows["peak_torque", "joint 1"].values["ftsmc"] == analysis.peak_torque(rivals["ftsmc"].run)[0]
    assert rows["settling_time.1e-8", "joint 1"].values["gravity_pd"] is None


def test_the_verdict_names_the_schemes_inside_and_the_best_of_them(rivals, page):
    inside = [name for name, rival in rivals.items() if rival.run.outcome.ok and rival.outside == 0]
    assert "hasty" not in inside and 1 < len(inside) < len(rivals)
    verdict = comparison_verdict(rivals)
    assert verdict.sentence.startswith(f"{len(inside)} of {len(rivals)} schemes stay inside the envelope: `cftsmppc`")
    errors = {name: max(analysis.steady_error(rivals[name].run)) for name in inside}
    best = min(errors, key=errors.get)
    assert verdict.facts[0] == f"`{best}` has the smallest steady error, {errors[best]:.2g} rad (worst joint)."
    assert "schemes stay inside the envelope" in page.read_text(encoding="utf-8").partition("<h2>")[0]
    alone = comparison_verdict({"hasty": rivals["hasty"]})
    assert (alone.good, alone.sentence, alone.facts) == (False, "No scheme stays inside the envelope.", ())


def test_a_single_scheme_is_never_the_best(rivals):
    assert not any(row.best for row in standings({"cftsmppc": rivals["cftsmppc"]}))


def test_the_comparison_page_is_self_contained_with_its_figures(page):
    text = page.read_text(encoding="utf-8")
    assert not re.findall(r"https?://|\ssrc=|<link|<script", text)
    names = {"tracking-errors", "velocity-errors", "torques", "tip-paths", "iae", "torque_energy", "torque_travel"}
    assert {path.stem for path in (page.parent / "figures").glob("*.svg")} == names
    assert text.count("<figure") == len(names) and "slidax compare x &gt; y" in text


def test_the_page_shows_best_values_in_bold_and_failed_runs(page, rivals):
    text = page.read_text(encoding="utf-8")
    row = next(row for row in standings(rivals) if row.metric is analysis.peak_torque)
    (best,) = row.best
    assert f"<b>{row.values[best]:.2f}</b>" in text
    assert rivals["hasty"].run.outcome.message.split(" (")[0] in text.replace("\xa0", " ")


def test_the_results_are_strict_json(page, rivals):
    def refuse(word):
        raise AssertionError(word)

    result = json.loads((page.parent / "results.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert list(result["schemes"]) == list(rivals) and result["schemes"]["hasty"]["outcome"] != "ok"
    assert result["schemes"]["hasty"]["stopped"]["joint"] in (1, 2)
    assert (
        result["schemes"]["ftsmc"]["metrics"]["paper"]["aice"] == analysis.torque_travel(rivals["ftsmc"].run).tolist()
    )
    assert all(len(names) == 2 for names in result["best"].values())


def test_values_that_are_not_finite_become_null(rivals):
    run = rivals["ftsmc"].run
    wild = eqx.tree_at(lambda r: r.tally.torque_square, run, run.tally.torque_square * float("inf"))
    result = results({"ftsmc": replace(rivals["ftsmc"], run=wild), "cftsmppc": rivals["cftsmppc"]})
    assert result["schemes"]["ftsmc"]["metrics"]["torque_energy"] == [None, None]
    assert result["best"]["torque_energy"] == [["cftsmppc"], ["cftsmppc"]]


def test_comparison_of_many_unlogged_runs_has_several_tables_and_no_figures(rivals, tmp_path):
    unlogged = replace(rivals["cftsmppc"], run=eqx.tree_at(lambda r: r.log, rivals["cftsmppc"].run, None))
    many = {f"scheme {i}": unlogged for i in range(14)}
    text = write_comparison(many, tmp_path).read_text(encoding="utf-8")
    assert "<figure" not in text and text.count("<th>Metric</th>") == 3


def test_runs_of_different_arms_are_not_compared(rivals, tmp_path):
    with pytest.raises(DefinitionError, match="at least one"):
        write_comparison({}, tmp_path)
    other = scenarios.load("example-4.2", {"simulation.t1": 0.1})
    with pytest.raises(DefinitionError, match="same arm"):
        write_comparison({"one": rivals["ftsmc"], "two": Rival(other, other.simulate(progress=False))}, tmp_path)


def test_a_scheme_without_an_envelope_is_counted_against_the_comparisons_envelope(rivals):
    """Checked against a log of every sample, and against the tally of the scheme with the envelope."""
    kept = scenarios.load("example-4.1", {"scheme.name": "gravity_pd", "simulation.t1": 1.0})
    narrow = scenarios.load("example-4.1", {"scheme.overshoot": 0.001, "simulation.t1": 1.0})
    free = Rival.simulated(kept, narrow, logged=False)
    assert free.run.log is None
    log, promise = kept.simulate(log_every=1).log, narrow.simulate(log_every=1).log
    lower, upper = promise.envelope.lower[0], promise.envelope.upper[0]
    shape = (promise.envelope.upper / upper)[: len(log.e)]
    outside = ((log.e[: len(shape)] <= lower * shape) | (log.e[: len(shape)] >= upper * shape)).any(axis=1)
    assert free.outside is not None and free.outside >= outside.sum() > 0
    assert rivals["cftsmppc"].outside == 0
    assert rivals["hasty"].outside == analysis.envelope_violations(rivals["hasty"].run) == 1
    assert Rival.simulated(kept, kept, logged=False).outside is None


def test_results_name_the_form_of_each_scheme():
    judge = scenarios.load("example-4.1-1khz", {"simulation.t1": 0.05})
    rival = scenarios.load(
        "example-4.1-1khz", {"simulation.t1": 0.05, "scheme.name": "nftsmc", "scheme.sampled_data": None}
    )
    both = {
        "cftsmppc": Rival.simulated(judge, judge, logged=False),
        "nftsmc": Rival.simulated(rival, judge, logged=False),
    }
    assert [each["form"] for each in results(both)["schemes"].values()] == ["sampled-data", "printed"]
