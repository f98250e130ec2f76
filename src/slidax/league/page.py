"""Output of the benchmark: a page, a table in Markdown, and all numbers as JSON."""

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
from .match import TaskResult
from .season import RoundResults
from .standing import Ranking, Score, ranking
from .summary import Overall, overall
from .task import VERSION


def write_benchmark(results: RoundResults, out: Path, *, seconds: float, command: str = "") -> Path:
    """Write `results` as `report.html`, `benchmark.md`, `results.json` and `figures/*.svg`; return the page's path.

    - `out`: a folder, made if missing.
    - `seconds`: duration of the round.
    - `command`: of the shell that made it.
    """
    out.mkdir(parents=True, exist_ok=True)
    tasks = results.round.tasks
    tables = [ranking(name, results.on(name)) for name in tasks]
    summaries = overall(tables, results.round.entries)
    software = {**versions(), "benchmark": str(VERSION)}
    values: dict[str, Any] = {
        "results": results,
        "tables": tables,
        "overall": summaries,
        "verdicts": dict(zip(tasks, verdicts(tables), strict=True)),
        "pictures": {table.task: _drawn(table, out / "figures") for table in tables if table.scores},
        "gains": {
            table.task: {score.entry: _gains(results, table.task, score) for score in table.scores} for table in tables
        },
        "tasks": {name: as_yaml(task) for name, task in tasks.items()},
        "refused": [(name, entry, why) for (name, entry), why in results.by_key.items() if isinstance(why, str)],
        "versions": software,
        "machine": machine(),
        "seconds": seconds,
        "command": command,
    }
    page = out / "report.html"
    write_text(page, render("benchmark.html.j2", values, packages=("slidax.league",)))
    write_text(out / "benchmark.md", markdown(results, tables, summaries, versions=software, command=command))
    text = json.dumps(as_json(results, tables, summaries), indent=1, allow_nan=False, ensure_ascii=False)
    write_text(out / "results.json", text + "\n")
    return page


def as_json(results: RoundResults, tables: list[Ranking], summaries: list[Overall]) -> dict[str, Any]:
    """Return all results, ready for JSON."""
    return {
        "version": VERSION,
        "budget": results.round.budget,
        "tasks": {table.task: _table_as_json(results, table) for table in tables},
        "overall": [{"scheme": each.entry.scheme, "form": each.entry.form, **each.numbers()} for each in summaries],
        "refused": [
            {"task": task, "scheme": entry.scheme, "form": entry.form, "why": why}
            for (task, entry), why in results.by_key.items()
            if isinstance(why, str)
        ],
    }


def _table_as_json(results: RoundResults, table: Ranking) -> dict[str, Any]:
    best = table.best
    return {
        "best": None if best is None else {"scheme": best.entry.scheme, "form": best.entry.form},
        "told_by": table.by,
        "p_value": table.p_value,
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
                "gains": _gains(results, table.task, score),
            }
            for score in table.scores
        ],
    }


def _gains(results: RoundResults, task: str, score: Score) -> dict[str, Any]:
    result = results.by_key[task, score.entry]
    return result.gains if isinstance(result, TaskResult) else {}


def _drawn(table: Ranking, folder: Path) -> Picture:
    lines = [
        Line(
            f"{score.entry.name}{' (printed)' if score.entry.form == 'printed' else ''}",
            score.inside,
            score.interval.lower,
            score.interval.upper,
            score.medians["steady_error"],
            score.leads,
        )
        for score in table.scores
    ]
    figure = figures.benchmark_table(lines, "cases inside the tolerance band  [%]", "steady error  [rad or m]")
    caption = (
        "Share of the held-out cases inside the tolerance band, with its interval; filled where it is not shown to be "
        "smaller than the largest. Right: median steady error of the worst joint, over the cases that were not lost."
    )
    return picture(figure, folder, table.task, table.task, caption)
