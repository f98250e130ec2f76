"""What a season shows: a page, a table in Markdown, and all numbers as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from slidax import figures
from slidax._writing import write_text
from slidax.figures.league_table import Line
from slidax.reports.machine import machine, versions
from slidax.reports.page import render
from slidax.reports.picture import Picture, picture
from slidax.scenarios.written import as_yaml

from .markdown import markdown, verdicts
from .match import Match
from .season import Results
from .standing import Score, Standing, standing
from .summary import Overall, overall
from .task import VERSION


def write_league(results: Results, out: Path, *, seconds: float, command: str = "") -> Path:
    """Writes `out/report.html`, `out/league.md`, `out/results.json` and `out/figures/*.svg`; returns the page's path.

    - `results`: of the season.
    - `out`: a folder, made if missing.
    - `seconds`: that it took.
    - `command`: the command that did it.
    """
    out.mkdir(parents=True, exist_ok=True)
    tables = [standing(name, results.on(name)) for name in results.season.tasks]
    whole = overall(tables, results.season.entries)
    made = {**versions(), "league": str(VERSION)}
    values: dict[str, Any] = {
        "results": results,
        "tables": tables,
        "overall": whole,
        "verdicts": dict(zip(results.season.tasks, verdicts(tables), strict=True)),
        "pictures": {one.task: _drawn(one, out / "figures") for one in tables if one.scores},
        "gains": {one.task: {score.entry: _gains(results, one.task, score) for score in one.scores} for one in tables},
        "tasks": {name: as_yaml(task) for name, task in results.season.tasks.items()},
        "refused": [(name, entry, one) for (name, entry), one in results.matches.items() if isinstance(one, str)],
        "versions": made,
        "machine": machine(),
        "seconds": seconds,
        "command": command,
    }
    page = out / "report.html"
    write_text(page, render("league.html.j2", values, packages=("slidax.league",)))
    text = markdown(results, tables, whole, versions=made, command=command)
    write_text(out / "league.md", text)
    said = json.dumps(as_json(results, tables, whole), indent=1, allow_nan=False, ensure_ascii=False)
    write_text(out / "results.json", said + "\n")
    return page


def as_json(results: Results, tables: list[Standing], whole: list[Overall]) -> dict[str, Any]:
    """All that was found, ready for JSON.

    - `results`: of the season.
    - `tables`: of its tasks.
    - `whole`: over all of them.
    """
    return {
        "version": VERSION,
        "budget": results.season.budget,
        "tasks": {one.task: _table_as_json(results, one) for one in tables},
        "overall": [{"scheme": one.entry.scheme, "form": one.entry.form, **one.numbers()} for one in whole],
        "refused": [
            {"task": task, "scheme": entry.scheme, "form": entry.form, "why": one}
            for (task, entry), one in results.matches.items()
            if isinstance(one, str)
        ],
    }


def _table_as_json(results: Results, one: Standing) -> dict[str, Any]:
    best = one.best
    return {
        "best": None if best is None else {"scheme": best.entry.scheme, "form": best.entry.form},
        "told_by": one.by,
        "p_value": one.p_value,
        "schemes": [
            {
                "scheme": score.entry.scheme,
                "form": score.entry.form,
                "inside": score.inside,
                "interval": [score.interval.lower, score.interval.upper],
                "failed": score.failed,
                "leads": score.leads,
                "behind_p_value": score.behind,
                "medians": dict(score.medians),
                "gains": _gains(results, one.task, score),
            }
            for score in one.scores
        ],
    }


def _gains(results: Results, task: str, score: Score) -> dict[str, Any]:
    match = results.matches[task, score.entry]
    return match.gains if isinstance(match, Match) else {}


def _drawn(one: Standing, folder: Path) -> Picture:
    lines = [
        Line(
            f"{score.entry.name}{' (printed)' if score.entry.form == 'printed' else ''}",
            score.inside,
            score.interval.lower,
            score.interval.upper,
            score.medians["steady_error"],
            score.leads,
        )
        for score in one.scores
    ]
    figure = figures.league_table(lines, "cases inside the tolerance band  [%]", "steady error  [rad or m]")
    caption = (
        "Share of the held-out cases inside the tolerance band, with its interval; filled where it is not shown to be "
    )
    caption += (
        "smaller than the largest. Right: median steady error of the worst joint, over the cases that were not lost."
    )
    return picture(figure, folder, one.task, one.task, caption)
