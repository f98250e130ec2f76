"""The whole reproduction, cut short, and what its page and its data must have."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax import paper, scenarios
from slidax.core.errors import DefinitionError
from slidax.paper.examples import Runs
from slidax.paper.numbers import Row, inverse_inertia, settling_bound
from slidax.paper.printed import TABLE_3, compare_printed
from slidax.paper.reproduce import counts, to_json_value
from slidax.report import Picture, typeset

# The module and not the function of this name.
REPRODUCE = importlib.import_module("slidax.paper.reproduce")
DRAWN: dict[str, Picture] = {}
"""The figures of `made`."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list[tuple[str, float]]]:
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


def test_it_leaves_a_page_figures_and_data(made) -> None:
    out, results, _ = made
    assert {path.name for path in out.iterdir()} == {"report.html", "results.json", "figures"}
    named = {"fig-1", "families", "fig-3", "fig-3-all", "fig-4-all", "fig-5-all", "fig-7a", "fig-7b"}
    named |= {f"fig-{number}" for number in range(8, 15)}
    assert {path.stem for path in (out / "figures").iterdir()} >= named
    assert all((out / figure).is_file() for figure in results["figures"])
    assert all(path.stat().st_size < 150_000 for path in (out / "figures").iterdir())


def test_the_data_is_strict_json_and_what_was_returned(made) -> None:
    out, results, _ = made

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = (out / "results.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=refuse) == results


def test_the_page_stands_alone(made) -> None:
    page = (made[0] / "report.html").read_text(encoding="utf-8")
    assert re.findall(r"https?://[^\s\"'<]+", page) == [f"https://doi.org/{paper.DOI}"]
    assert not re.findall(r"\ssrc=|<link|<script|@import|url\((?!#)", page)
    identifiers = re.findall(r'\sid="([^"]+)"', page)
    targets = re.findall(r'(?:xlink:href="#|url\(#)([^")]+)', page)
    assert set(targets) <= set(identifiers)


def test_the_page_shows_every_printed_value_and_every_verdict(made) -> None:
    page = (made[0] / "report.html").read_text(encoding="utf-8")
    for row in made[1]["numbers"]:
        assert f'<td class="n">{typeset(row["printed"])}</td>' in page
        for verdict in row["verdicts"].values():
            assert f'<span class="verdict {verdict["kind"]}">{typeset(verdict["text"])}</span>' in page
    for claim in (*made[1]["claims"], *made[1]["promises"]):
        assert str(typeset(claim["says"])) in page
        for evidence in claim["evidence"].values():
            assert str(typeset(evidence)) in page
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL).lower().split()


def test_the_printed_values_are_the_papers() -> None:
    assert {item.quantity: item.values for item in TABLE_3["cftsmppc"]} == {
        "settling_time": (1.37, 1.35, 1.53),
        "steady_error": (4.92e-11, 6.90e-11, 2.21e-11),
        "peak_torque": (12.19, 14.96, 15.17),
    }


def test_computed_values_and_verdicts_come_from_the_runs(made) -> None:
    """Peak torques lie in the first second, so that the short run has those of the whole."""
    rows = [row for row in made[1]["numbers"] if row["quantity"] == "peak_torque" and row["scheme"] == "CFTSMPPC"]
    assert [row["computed"]["stated"] for row in rows] == pytest.approx([9.5388, 8.6503, 14.4316], rel=1e-4)
    assert [row["verdicts"]["stated"]["kind"] for row in rows] == ["differs", "differs", "reproduced"]
    assert [row["unit"] for row in rows] == ["N m", "N m", "N"]
    settling = [row for row in made[1]["numbers"] if row["quantity"] == "settling_time" and row["scheme"] == "CFTSMPPC"]
    assert all(row["computed"]["off"] is None for row in settling)
    assert all(row["verdicts"]["off"]["kind"] == "differs" for row in settling)


def test_statements_on_the_runs_hold_as_far_as_they_went(made) -> None:
    kinds = {(claim["place"], claim["says"]): claim["verdicts"] for claim in made[1]["claims"]}
    assert len(kinds) == 6
    for (_, says), verdicts in kinds.items():
        expected = "unchecked" if "final radius" in says else "reproduced"
        assert {verdict["kind"] for verdict in verdicts.values()} == {expected}


def test_the_counts_are_those_of_the_verdicts(made) -> None:
    results = made[1]
    for reading, kinds in results["counts"].items():
        items = [*results["numbers"], *results["claims"]]
        for kind, count in kinds.items():
            assert count == sum(item["verdicts"][reading]["kind"] == kind for item in items)
        assert sum(kinds.values()) == len(items)


FULL = pytest.mark.full
READINGS = [("stated", False), pytest.param("stated", True, marks=FULL), pytest.param("off", True, marks=FULL)]


@pytest.mark.full
@pytest.mark.parametrize(("disturbance", "drawn"), READINGS)
def test_one_reading_of_the_disturbance_makes_a_page_too(made, tmp_path, monkeypatch, disturbance, drawn) -> None:
    """With the figures of `made` every day: they are of the first reading there, too."""
    if not drawn:
        monkeypatch.setattr(REPRODUCE, "draw", lambda runs, folder: DRAWN)
    results = paper.reproduce(tmp_path, disturbance, changes={"simulation.t1": 1.0})
    assert list(results["readings"]) == [disturbance]
    for item, both in zip(results["numbers"], made[1]["numbers"], strict=True):
        assert item["computed"] == {disturbance: both["computed"][disturbance]}
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert results["readings"][disturbance].capitalize() in page


def test_progress_goes_forward_to_its_end(made) -> None:
    fractions = [done for _, done in made[2]]
    assert fractions == sorted(fractions)
    assert fractions[0] == 0.0
    assert made[2][-1] == ("Done", 1.0)


def test_another_disturbance_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match='"stated", "off", "both"'):
        paper.reproduce(tmp_path / "none", "on")
    assert not (tmp_path / "none").exists()


def test_bounds_are_those_of_the_formulas_and_the_arm() -> None:
    two_link = scenarios.load("example-4.1")
    result = inverse_inertia(two_link)
    assert result["eigenvalues"] == pytest.approx([0.0889, 0.1970], abs=1e-4)
    assert result["spectral"][1] == pytest.approx(0.197, abs=1e-3)
    assert result["frobenius"][1] == pytest.approx(0.247, abs=1e-3)
    assert result["mismatch"] == pytest.approx(0.2)
    assert result["gamma"] == pytest.approx(0.11 / 0.29)
    assert settling_bound(two_link)["bound"] == pytest.approx(430, abs=1)
    assert settling_bound(scenarios.load("example-4.2"))["bound"] == pytest.approx(65, abs=0.5)


def test_what_is_not_finite_becomes_null() -> None:
    row = Row(
        "x", "q", "p", "n", "1", "s", "1.0", "c", {"off": float("nan")}, {"off": compare_printed(1.0, float("nan"))}
    )
    assert to_json_value([row, {"a": (float("inf"), 1.0)}])[0]["computed"] == {"off": None}
    assert to_json_value({"a": (float("inf"), 1.0)}) == {"a": [None, 1.0]}
    assert counts([row], []) == {"off": {"reproduced": 0, "close": 0, "differs": 0, "unchecked": 1}}


def test_plain_data_has_no_arrays(made) -> None:
    def walk(value: Any) -> None:
        assert isinstance(value, dict | list | str | int | float | bool | None), type(value)
        assert not isinstance(value, np.generic)
        for entry in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            walk(entry)

    walk(made[1])
