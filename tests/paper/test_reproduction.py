"""The whole reproduction, cut short: its page, its data, its verdicts, and the rivals of the paper."""

import importlib
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax import analysis, paper, scenarios
from slidax.core.errors import DefinitionError
from slidax.core.files import json_value
from slidax.paper import PrintedComparison, compare_limit, compare_printed, printed
from slidax.paper.claims import run_with_printed_alpha
from slidax.paper.examples import COMPARED, SCHEMES, Case, Runs, cases, scenario_of
from slidax.paper.numbers import Row, chatter, inverse_inertia, settling_bound, table_3
from slidax.paper.printed import TABLE_3, mark_incomparable
from slidax.paper.reproduce import counts
from slidax.report import Picture, typeset
from slidax.simulation import Run

# The module, not the function of the same name.
REPRODUCE = importlib.import_module("slidax.paper.reproduce")
DRAWN: dict[str, Picture] = {}
"""The figures of `reproduced`."""


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    out = tmp_path_factory.mktemp("reproduction") / "new"
    told: list[tuple[str, float]] = []

    def draw(runs: Runs, folder: Path, draw: Callable = REPRODUCE.draw) -> dict[str, Picture]:
        DRAWN.update(draw(runs, folder))
        return DRAWN

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(REPRODUCE, "draw", draw)
        results = paper.reproduce(
            out, progress=lambda stage, done: told.append((stage, done)), changes={"simulation.t1": 1.0}
        )
    return out, results, told


def test_reproduction_writes_a_page_figures_and_data(reproduced):
    out, results, _ = reproduced
    assert {path.name for path in out.iterdir()} == {"report.html", "results.json", "figures"}
    named = {"fig-1", "families", "fig-3", "fig-3-all", "fig-4-all", "fig-5-all", "fig-7a", "fig-7b"}
    named |= {f"fig-{number}" for number in range(8, 15)}
    assert {path.stem for path in (out / "figures").iterdir()} >= named
    assert {out / figure for figure in results["figures"]} == set((out / "figures").iterdir())
    assert all(path.stat().st_size < 150_000 for path in (out / "figures").iterdir())


def test_the_data_is_strict_json_and_equals_the_returned_results(reproduced):
    out, results, _ = reproduced

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = (out / "results.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=refuse) == results


def test_the_reproduction_page_is_self_contained(reproduced):
    page = (reproduced[0] / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"https?://[^\s\"'<]+", page) == [f"https://doi.org/{paper.DOI}"]
    assert not re.findall(r"\ssrc=|<link|<script|@import|url\((?!#)", page)
    identifiers = re.findall(r'\sid="([^"]+)"', page)
    targets = re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', page)
    assert set(targets) <= set(identifiers)


def test_the_page_shows_every_printed_value_and_every_verdict(reproduced):
    page = (reproduced[0] / "report.html").read_text(encoding="utf-8")
    for row in reproduced[1]["numbers"]:
        assert f'<td class="n">{typeset(row["printed"])}</td>' in page
        for verdict in row["verdicts"].values():
            assert f'<span class="verdict {verdict["kind"]}">{typeset(verdict["text"])}</span>' in page
    for claim in (*reproduced[1]["claims"], *reproduced[1]["promises"]):
        assert str(typeset(claim["says"])) in page
        for evidence in claim["evidence"].values():
            assert str(typeset(evidence)) in page
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL).lower().split()


def test_computed_values_and_verdicts_come_from_the_runs(reproduced):
    """Peak torques occur in the first second, so the short run has those of the whole run."""
    rows = [row for row in reproduced[1]["numbers"] if row["quantity"] == "peak_torque" and row["scheme"] == "CFTSMPPC"]
    assert [row["computed"]["stated"] for row in rows] == pytest.approx([9.5388, 8.6503, 14.4316], rel=1e-4)
    assert [row["verdicts"]["stated"]["kind"] for row in rows] == ["differs", "differs", "reproduced"]
    assert [row["unit"] for row in rows] == ["N m", "N m", "N"]
    settling = [
        row for row in reproduced[1]["numbers"] if row["quantity"] == "settling_time" and row["scheme"] == "CFTSMPPC"
    ]
    assert [row["computed"]["off"] for row in settling] == [None] * 3
    assert all(row["verdicts"]["off"]["kind"] == "differs" for row in settling)


def test_claims_about_the_final_radius_are_unchecked_in_a_short_run(reproduced):
    kinds = {(claim["place"], claim["says"]): claim["verdicts"] for claim in reproduced[1]["claims"]}
    assert len(kinds) == 6
    for (_, says), verdicts in kinds.items():
        expected = "unchecked" if "final radius" in says else "reproduced"
        assert {verdict["kind"] for verdict in verdicts.values()} == {expected}


def test_verdict_counts_agree_with_the_listed_verdicts(reproduced):
    results = reproduced[1]
    assert set(results["counts"]) == {"stated", "off"}
    for reading, kinds in results["counts"].items():
        items = [*results["numbers"], *results["claims"]]
        for kind, count in kinds.items():
            assert count == sum(item["verdicts"][reading]["kind"] == kind for item in items)
        assert sum(kinds.values()) == len(items)


FULL = pytest.mark.full
READINGS = [("stated", False), pytest.param("stated", True, marks=FULL), pytest.param("off", True, marks=FULL)]


@pytest.mark.full
@pytest.mark.parametrize(("disturbance", "drawn"), READINGS)
def test_a_single_disturbance_reading_gives_the_same_values(reproduced, tmp_path, monkeypatch, disturbance, drawn):
    """Reuses the figures of `reproduced`, which show the same reading, unless `drawn`."""
    if not drawn:
        monkeypatch.setattr(REPRODUCE, "draw", lambda runs, folder: DRAWN)
    results = paper.reproduce(tmp_path, disturbance, changes={"simulation.t1": 1.0})
    assert list(results["readings"]) == [disturbance]
    for item, both in zip(results["numbers"], reproduced[1]["numbers"], strict=True):
        assert item["computed"] == {disturbance: both["computed"][disturbance]}
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert results["readings"][disturbance].capitalize() in page


def test_progress_goes_forward_to_its_end(reproduced):
    fractions = [done for _, done in reproduced[2]]
    assert fractions == sorted(fractions) and fractions[0] == 0.0 and reproduced[2][-1] == ("Done", 1.0)


def test_an_unknown_disturbance_reading_is_refused(tmp_path):
    with pytest.raises(DefinitionError, match='"stated", "off", "both"'):
        paper.reproduce(tmp_path / "none", "on")
    assert not (tmp_path / "none").exists()


def test_inverse_inertia_and_settling_time_bounds_have_the_expected_values():
    two_link = scenarios.load("example-4.1")
    result = inverse_inertia(two_link)
    assert result["eigenvalues"] == pytest.approx([0.0889, 0.1970], abs=1e-4)
    assert result["spectral"][1] == pytest.approx(0.197, abs=1e-3)
    assert result["frobenius"][1] == pytest.approx(0.247, abs=1e-3) and result["mismatch"] == pytest.approx(0.2)
    assert result["gamma"] == pytest.approx(0.11 / 0.29)
    assert settling_bound(two_link)["bound"] == pytest.approx(430, abs=1)
    assert settling_bound(scenarios.load("example-4.2"))["bound"] == pytest.approx(65, abs=0.5)


def test_infinite_values_become_null_in_the_data():
    row = Row(
        "x", "q", "p", "n", "1", "s", "1.0", "c", {"off": float("nan")}, {"off": compare_printed(1.0, float("nan"))}
    )
    assert json_value([row])[0]["computed"] == {"off": None}
    assert json_value({"a": (float("inf"), 1.0)}) == {"a": [None, 1.0]}
    assert counts([row], []) == {"off": {"reproduced": 0, "close": 0, "differs": 0, "unchecked": 1}}


def test_returned_results_are_plain_data_without_arrays(reproduced):
    def walk(value: Any) -> None:
        assert isinstance(value, dict | list | str | int | float | bool | None), type(value)
        assert not isinstance(value, np.generic)
        for entry in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            walk(entry)

    walk(reproduced[1])


def simulated(case: Case, t1: float) -> Run:
    return scenario_of(case, {"simulation.t1": t1}).simulate(progress=False)


def test_table_3_is_as_printed_in_the_paper():
    assert [items[0].texts for items in TABLE_3.values()] == [
        ("1.37", "1.35", "1.53"),
        ("1.77", "1.47", "1.75"),
        ("1.79", "1.47", "1.76"),
        ("2.20", "2.12", "2.35"),
    ]
    assert [items[1].values[0] for items in TABLE_3.values()] == [4.92e-11, 1.89e-5, 2.81e-6, 3.08e-4]
    assert [items[2].values[2] for items in TABLE_3.values()] == [15.17, 100.52, 39.44, 45.37]
    assert set(TABLE_3) == set(COMPARED["4.2"])
    assert {item.quantity: item.values for item in TABLE_3["cftsmppc"]} == {
        "settling_time": (1.37, 1.35, 1.53),
        "steady_error": (4.92e-11, 6.90e-11, 2.21e-11),
        "peak_torque": (12.19, 14.96, 15.17),
    }


def test_every_scheme_runs_once_in_each_case():
    listed = cases(("stated", "off"))
    assert len(listed) == len(set(listed))
    for example, schemes in COMPARED.items():
        for scheme in schemes:
            case = Case(example, "stated", scheme=scheme)
            assert {case, case.halved, case.relayered} <= set(listed)
            reading = SCHEMES[scheme].nearest if example == "4.2" else "stated"
            assert Case(example, reading, scheme=scheme).held in listed


def test_a_case_sets_the_parameters_of_its_scenario():
    scenario = scenario_of(Case("4.2", "off", "held", 2e-4, "nftsmc", 3e-4), {})
    assert (scenario.scheme, scenario.stepping.mode, scenario.period) == ("nftsmc", "held", 2e-4)
    assert float(scenario.controller.layer) == 3e-4 and scenario.description.disturbance.scale == 0.0


def test_ftsmc_settling_times_and_peak_torques_agree_with_independent_values():
    run = simulated(Case("4.1", "stated", scheme="ftsmc"), 2.0)
    assert table_3(run, "settling_time", 1e-3) == pytest.approx([1.027, 0.968], abs=0.003)
    assert analysis.peak_torque(run) == pytest.approx([88.21, 66.51], rel=1e-3)
    layered = simulated(Case("4.1", "stated", scheme="ftsmc", layer=0.05), 2.0)
    # Its torque jumps where |e| enters the core of the surface.
    assert table_3(layered, "settling_time", 1e-2) == pytest.approx([0.881, 0.827], abs=1e-3)


def test_anftsmc_without_disturbance_settles_near_the_printed_times():
    case = Case("4.2", "off", scheme="anftsmc")
    run = simulated(case, 3.0)
    assert table_3(run, "settling_time", 1e-5) == pytest.approx([1.74, 1.45, 1.74], abs=0.03)
    scenario = scenario_of(case, {"simulation.t1": 3.0})
    wrong = run_with_printed_alpha(Runs({case: scenario}, {case: run}, ("off",)))
    assert (np.array(wrong["peak_torque"]) > 100.0 * analysis.peak_torque(run)).all()


def test_initial_torque_of_sfsmc_at_joint_3_agrees_with_an_independent_value():
    run = simulated(Case("4.2", "stated", scheme="sfsmc"), 0.1)
    assert analysis.initial_torque(run)[2] == pytest.approx(44.4, rel=0.01)


def test_torque_travel_of_a_chattering_law_depends_on_the_step():
    smooth, rough = (Case("4.1", "stated", scheme="ftsmc", layer=layer) for layer in (0.05, 0.0))
    assert chatter(simulated(smooth, 2.0), simulated(smooth.halved, 2.0)) == [None, None]
    grown = chatter(simulated(rough, 2.0), simulated(rough.halved, 2.0))
    assert all(way is not None and 1.5 < way < 2.5 for way in grown)
    assert mark_incomparable("why").kind == "unchecked"


def test_settling_bound_is_the_sum_of_its_reaching_and_sliding_terms():
    result = settling_bound(scenarios.load("example-4.1", {"scheme.name": "ftsmc"}))
    assert result is not None
    # K0 = I, k = 1, r = 1.2, n = 2, m1 + m2 = .29; k1 = 1.5, p = .5, k2 = 1, q = 1.2, and 2 for ρ0.
    reaching = [2 / np.sqrt(0.29), 2 / (2**-0.1 * 0.29**1.1 * 0.2)]
    sliding = [2**0.25 / (1.5 * 0.5), 2**-0.1 / 0.2]
    assert result["terms"]["reaching"] == pytest.approx(reaching)
    assert result["terms"]["sliding"] == pytest.approx(sliding)
    assert result["bound"] == pytest.approx(sum(reaching) + sum(sliding)) and result["deadlines"] is None
    assert settling_bound(scenarios.load("example-4.2", {"scheme.name": "sfsmc"})) is not None
    assert settling_bound(scenarios.load("example-4.2", {"scheme.name": "nftsmc"})) is None


@pytest.mark.parametrize(
    ("computed", "kind"),
    [
        (100.0, "reproduced"),
        (105.0, "reproduced"),
        (95.0, "reproduced"),
        (105.01, "close"),
        (94.99, "close"),
        (120.0, "close"),
        (80.0, "close"),
        (120.01, "differs"),
        (79.99, "differs"),
        (1000.0, "differs"),
        (0.0, "differs"),
        (math.nan, "unchecked"),
        (math.inf, "unchecked"),
        (None, "unchecked"),
    ],
)
def test_a_value_counts_as_reproduced_within_5_percent_and_as_close_within_20(computed, kind):
    assert compare_printed(100.0, computed).kind == kind


@pytest.mark.parametrize(
    ("computed", "text"),
    [
        (100.0, "reproduced within 0.1 %"),
        (102.24, "reproduced within 2.3 %"),
        (97.5, "reproduced within 2.5 %"),
        (107.21, "close: 7.3 % above"),
        (92.0, "close: 8.0 % below"),
        (78.0, "differs: 0.78 times printed"),
        (1.0e6, "differs: 1.0e4 times printed"),
    ],
)
def test_comparison_with_a_printed_value_states_the_deviation_in_percent_or_as_a_factor(computed, text):
    assert compare_printed(100.0, computed).text == text


def test_comparison_with_a_printed_value_does_not_depend_on_its_unit():
    for scale in (1e-12, 1.0, 1e9):
        assert compare_printed(4.92 * scale, 5.03 * scale) == compare_printed(4.92, 5.03)


def test_a_missing_value_takes_the_supplied_verdict():
    never = PrintedComparison("differs", "never")
    assert compare_printed(1.0, None, never) == never and compare_printed(1.0, 1.0, never).kind == "reproduced"


def test_a_printed_limit_holds_only_for_values_below_it():
    assert compare_limit(8e-11, 7.99e-11).kind == "reproduced" and compare_limit(8e-11, 8e-11).kind == "differs"
    assert compare_limit(8e-11, 8e-7).text == "does not hold: 1.0e4 times the limit"
    assert compare_limit(8e-11, None).kind == "unchecked"


def test_a_true_claim_is_reproduced_and_a_false_claim_differs():
    assert (printed.claim(True).kind, printed.claim(False).kind) == ("reproduced", "differs")
