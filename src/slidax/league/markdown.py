"""The benchmark's table in Markdown, with a verdict for each task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from slidax.reports.numbers import significant

from .entry import BenchmarkEntry
from .season import RoundResults
from .standing import CONFIDENCE, Ranking, Score, holm
from .summary import Overall

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
    """Return the table of all schemes, and the verdict for each task.

    - `command`: of the shell that made the results.
    """
    tasks = results.round.tasks.values()
    held, trained = (
        " or ".join(map(str, sorted({getattr(task, name).cases for task in tasks})))
        for name in ("held_out", "training")
    )
    rows = ["| " + " | ".join(HEAD) + " |", "|---|---|" + "---:|" * (len(HEAD) - 2)]
    rows += ["| " + " | ".join(_cells(each, len(tables))) + " |" for each in summaries]
    lines = [f"- `{table.task}`: {line}" for table, line in zip(tables, verdicts(tables), strict=True)]
    software = ", ".join(f"{name} {number}" for name, number in versions.items())
    return "\n".join(
        [
            *rows,
            "",
            f"{len(tables)} tasks; each scheme tuned by {results.round.budget} sets of gains on {trained} training "
            f"cases a task, scored on {held} others. Errors and torque steps are medians over the cases, as multiples "
            "of the task's least, on average over the tasks.",
            "",
            *lines,
            "",
            f"Made by `{command or 'slidax benchmark'}` with {software}.",
            "",
        ]
    )


def verdicts(tables: Sequence[Ranking]) -> list[str]:
    """Return a line for each task: the best scheme, and the significance of its lead, by Holm over the tasks."""
    adjusted = holm([table.p_value for table in tables])
    return [_verdict(table, p_value) for table, p_value in zip(tables, adjusted, strict=True)]


def _verdict(table: Ranking, p_value: float) -> str:
    best = table.best
    if best is None:
        return "no scheme keeps the tolerance band in any case"
    share = best.interval
    text = (
        f"**{named(best.entry)}**, {percent(best.inside)} of the cases inside "
        f"[{percent(share.lower)}, {percent(share.upper)}]"
    )
    if len(table.scores) < 2:
        return text
    second = table.scores[1]
    sure = "significant" if p_value < 1.0 - CONFIDENCE else "not significant"
    by = f"{table.by}: {_numbers(table.by, best)} to {_numbers(table.by, second)}"
    return f"{text}; next {named(second.entry)}, by {by}, a difference that is {sure} (p = {p_value:.2g})"


def _numbers(by: str, score: Score) -> str:
    return percent(score.inside) if by == "share inside" else significant(score.medians["steady_error"], 2)


def named(entry: BenchmarkEntry) -> str:
    """Return a scheme's name with its form."""
    return f"{entry.name} ({entry.form})"


def percent(share: float) -> str:
    """Format a share of 1 in percent; 100 % and 0 % appear only for all and nothing."""
    if 0.995 <= share < 1.0 or 0.0 < share < 0.005:
        return f"{100 * share:.1f} %"
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
