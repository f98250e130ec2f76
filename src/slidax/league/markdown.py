"""The table of a season in Markdown, with a line for each task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from slidax.reports.numbers import significant

from .entry import Entry
from .season import Results
from .standing import CONFIDENCE, Score, Standing, holm
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
    results: Results,
    tables: Sequence[Standing],
    whole: Sequence[Overall],
    *,
    versions: Mapping[str, str],
    command: str,
) -> str:
    """The table of all schemes, and who is best on each task.

    - `results`: of the season.
    - `tables`: of its tasks.
    - `whole`: over all of them.
    - `versions`: of the software.
    - `command`: that made it.
    """
    season = results.season
    held = sorted({task.held_out.cases for task in season.tasks.values()})
    trained = sorted({task.training.cases for task in season.tasks.values()})
    rows = ["| " + " | ".join(HEAD) + " |", "|---|---|" + "---:|" * (len(HEAD) - 2)]
    rows += ["| " + " | ".join(_cells(one, len(tables))) + " |" for one in whole]
    lines = [f"- `{table.task}`: {line}" for table, line in zip(tables, verdicts(tables), strict=True)]
    made = ", ".join(f"{name} {number}" for name, number in versions.items())
    cases, seen = (" or ".join(map(str, some)) for some in (held, trained))
    return "\n".join(
        [
            *rows,
            "",
            f"{len(tables)} tasks; each scheme tuned by {season.budget} sets of gains on {seen} training cases a task, "
            f"scored on {cases} others. Errors and torque steps are medians over the cases, as multiples of the task's "
            "least, on average over the tasks.",
            "",
            *lines,
            "",
            f"Made by `{command or 'slidax league'}` with {made}.",
            "",
        ]
    )


def verdicts(tables: Sequence[Standing]) -> list[str]:
    """A line for each task: who is best, and whether the difference to the next is significant, by Holm over the tasks.

    - `tables`: of the tasks.
    """
    adjusted = holm([table.p_value for table in tables])
    return [_verdict(table, p_value) for table, p_value in zip(tables, adjusted, strict=True)]


def _verdict(table: Standing, p_value: float) -> str:
    best = table.best
    if best is None:
        return "no scheme keeps the tolerance band in any case"
    share = best.interval
    said = (
        f"**{named(best.entry)}**, {percent(best.inside)} of the cases inside "
        f"[{percent(share.lower)}, {percent(share.upper)}]"
    )
    if len(table.scores) < 2:
        return said
    second = table.scores[1]
    sure = "significant" if p_value < 1.0 - CONFIDENCE else "not significant"
    by = f"{table.by}: {_numbers(table.by, best)} to {_numbers(table.by, second)}"
    return f"{said}; next {named(second.entry)}, by {by}, a difference that is {sure} (p = {p_value:.2g})"


def _numbers(by: str, score: Score) -> str:
    return percent(score.inside) if by == "share inside" else significant(score.medians["steady_error"], 2)


def named(entry: Entry) -> str:
    """A scheme with its form.

    - `entry`: the scheme.
    """
    return f"{entry.name} ({entry.form})"


def percent(share: float) -> str:
    """A share in percent, which is 100 % or 0 % only if it is all or nothing.

    - `share`: of 1.
    """
    if 0.995 <= share < 1.0 or 0.0 < share < 0.005:
        return f"{100 * share:.1f} %"
    return f"{100 * share:.0f} %"


def _cells(one: Overall, tasks: int) -> list[str]:
    return [
        f"`{one.entry.name}`",
        one.entry.form,
        percent(one.inside),
        f"{one.leads} of {tasks}",
        f"{one.best}",
        "–" if one.error is None else f"× {significant(one.error, 2)}",
        "–" if one.step is None else f"× {significant(one.step, 2)}",
        percent(one.failed),
    ]
