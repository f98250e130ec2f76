"""Output of the benchmark: an HTML report, a table in Markdown, and all numbers as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from slidax.core.writing import write_text
from slidax.scenarios.yaml_text import as_yaml
from slidax.studies.benchmark.entries import VERSION, BenchmarkEntry
from slidax.studies.benchmark.ranking import CONFIDENCE, Overall, Ranking, Score, holm, rank_overall, ranking
from slidax.studies.benchmark.rounds import RoundResults, TaskResult

from . import figures
from .figures.studies import RankingLine
from .page import Picture, machine, picture, render, significant, versions

HEAD = (
    "scheme",
    "form",
    "cases inside the tolerance band",
    "leads on",
    "best on",
    "steady error",
    "torque step, steady",
    "lost",
)


def markdown(
    results: RoundResults,
    tables: Sequence[Ranking],
    summaries: Sequence[Overall],
    *,
    versions: Mapping[str, str],
    command: str,
) -> str:
    """Return the table of all schemes, and the verdict for each task, as Markdown.

    - `tables`, `summaries`: rankings of the tasks, and summaries of the schemes over all tasks.
    - `versions`: version of each package, by name.
    - `command`: shell command that computed the results.
    """
    tasks = results.round.tasks.values()
    held, trained = (
        " or ".join(map(str, sorted({getattr(task, name).cases for task in tasks})))
        for name in ("held_out", "training")
    )
    rows = ["| " + " | ".join(HEAD) + " |", "|---|---|" + "---:|" * (len(HEAD) - 2)]
    rows += ["| " + " | ".join(_cells(each, len(tables))) + " |" for each in summaries]
    lines = [f"- `{table.task}`: {line}" for table, line in zip(tables, summarise_tasks(tables), strict=True)]
    software = ", ".join(f"{name} {number}" for name, number in versions.items())
    return "\n".join(
        [
            *rows,
            "",
            f"{len(tables)} tasks; each scheme tuned by {results.round.budget} sets of gains on {trained} training "
            f"cases a task, scored on {held} others. Errors and torque steps are medians over the cases, as multiples "
            "of the task's least, with the geometric mean over the tasks.",
            "",
            *lines,
            "",
            f"Made by `{command or 'slidax benchmark'}` with {software}.",
            "",
        ]
    )


def summarise_tasks(tables: Sequence[Ranking]) -> list[str]:
    """Return a line of text for each task, with the best scheme and the significance of its lead over the second.

    Holm's method adjusts the p-values for the number of tasks.
    """
    adjusted = holm([table.p_value for table in tables])
    return [_verdict(table, p_value) for table, p_value in zip(tables, adjusted, strict=True)]


def _verdict(table: Ranking, p_value: float) -> str:
    best = table.best
    if best is None:
        return "no scheme keeps the tolerance band in any case"
    share = best.interval
    text = (
        f"**{name_with_form(best.entry)}** is the best, with {percent(best.inside)} of the cases inside "
        f"[{percent(share.lower)}, {percent(share.upper)}]"
    )
    if len(table.scores) < 2:
        return text
    second = table.scores[1]
    sure = "significant" if p_value < 1.0 - CONFIDENCE else "not significant"
    by = f"{table.by}, {_numbers(table.by, best)} against {_numbers(table.by, second)}"
    return f"{text}; next is {name_with_form(second.entry)}, by {by} ({sure}, p = {p_value:.2g})"


def _numbers(by: str, score: Score) -> str:
    return percent(score.inside) if by == "share inside" else significant(score.medians["steady_error"], 2)


def name_with_form(entry: BenchmarkEntry) -> str:
    """Return a scheme's name with its form, such as `cftsmppc (printed)`."""
    return f"{entry.name} ({entry.form})"


def percent(share: float) -> str:
    """Format a share from 0 to 1 in percent; `100 %` and `0 %`, without a decimal, appear only for 1 and 0."""
    if 0.995 <= share < 1.0 or 0.0 < share < 0.005:
        return f"{min(max(100 * share, 0.1), 99.9):.1f} %"
    return f"{100 * share:.0f} %"


def _cells(summary: Overall, tasks: int) -> list[str]:
    return [
        f"`{summary.entry.name}`",
        summary.entry.form,
        percent(summary.inside),
        f"{summary.leads} of {tasks}",
        f"{summary.best}",
        "–" if summary.error is None else f"× {significant(summary.error, 2)}",
        "–" if summary.step is None else f"× {significant(summary.step, 2)}",
        percent(summary.failed),
    ]


def write_benchmark(results: RoundResults, out: Path, *, seconds: float, command: str = "") -> Path:
    """Write `results` as `report.html`, `benchmark.md`, `results.json` and `figures/*.svg`; return the page's path.

    - `out`: a folder, made if missing.
    - `seconds`: duration of the round [s], for the page.
    - `command`: shell command that computed the results.
    """
    out.mkdir(parents=True, exist_ok=True)
    tasks = results.round.tasks
    tables = [ranking(name, results.on(name)) for name in tasks]
    summaries = rank_overall(tables, results.round.entries)
    software = {**versions(), "benchmark": str(VERSION)}
    values: dict[str, Any] = {
        "results": results,
        "tables": tables,
        "overall": summaries,
        "verdicts": dict(zip(tasks, summarise_tasks(tables), strict=True)),
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
    write_text(page, render("benchmark.html.j2", values, packages=("slidax.report",)))
    write_text(out / "benchmark.md", markdown(results, tables, summaries, versions=software, command=command))
    text = json.dumps(as_json(results, tables, summaries), indent=1, allow_nan=False, ensure_ascii=False)
    write_text(out / "results.json", text + "\n")
    return page


def as_json(results: RoundResults, tables: list[Ranking], summaries: list[Overall]) -> dict[str, Any]:
    """Return the contents of `results.json`: rankings, summaries of schemes, and schemes that cannot run on a task."""
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
        RankingLine(
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
        "Left: share of the held-out cases inside the tolerance band, with its confidence interval. A filled dot is "
        "not significantly below the largest share. Right: median steady error of the worst joint, without lost cases."
    )
    return picture(figure, folder, table.task, table.task, caption)
