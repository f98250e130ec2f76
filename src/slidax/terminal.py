"""What the commands print about their runs: tables for a person, JSON for a program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from slidax._errors import counted
from slidax.metrics import envelope_violations, metrics_of, short_names, summary
from slidax.papers.indices import INDICES

if TYPE_CHECKING:
    from slidax.certificates import Certificates, Verdict
    from slidax.deploy.robot_loop import Looped
    from slidax.metrics import Metric
    from slidax.reports import Rival
    from slidax.scenarios import Scenario
    from slidax.simulation import Run
    from slidax.studies import AbstractResult, Section

OUTSIDE = envelope_violations.title
WIDTH = 9
"""Of the numbers in a table [characters]: `1.234e-05`."""


def run_as_json(parts: Scenario, finished: Run, import_s: float) -> dict[str, Any]:
    """What `slidax run --json` prints.

    - `parts`: what was simulated.
    - `finished`: the run.
    - `import_s`: seconds that went by before it.
    """
    outcome = finished.outcome
    timing = finished.timing
    return {
        "scenario": parts.name,
        "robot": parts.robot,
        "scheme": parts.scheme,
        "n": finished.joints,
        "period": parts.period,
        "t1": parts.t1,
        "outcome": outcome.kind,
        "stopped": outcome.stopped,
        "metrics": summary(finished, INDICES),
        "timing": {
            "import_s": round(import_s, 4),
            "compile_s": round(timing.compile_s, 4) if timing else None,
            "run_s": round(timing.run_s, 4) if timing else None,
            "steps": round(parts.t1 / parts.period),
        },
    }


def print_run(parts: Scenario, finished: Run, answer: dict[str, Any]) -> None:
    """The metrics of one run, joint by joint, and its outcome.

    Where the terminal is too narrow for all joints, some of them follow in a table of their own.

    - `parts`: what was simulated.
    - `finished`: the run.
    - `answer`: what `slidax run --json` prints of it.
    """
    rows: list[tuple[str, list[float | None]]] = []
    for metric in (*metrics_of(finished), *INDICES):
        values = metric.shown(finished) if metric.per_joint and metric.source in parts.description.source else []
        if any(value is not None for value in values) or metric.needs_settling:
            rows.append((_titled(metric.title, metric.units(finished)), values))
    console = Console(markup=False, highlight=False)
    console.print(parts.description.title, style="bold", soft_wrap=True)
    names = short_names(finished.joint_names)
    widest = max(len(title) for title, _ in rows)
    for number, shown in enumerate(_fitting(names, console.width - widest)):
        table = _table(widest, shown)
        for title, values in rows:
            table.add_row(title, *(_cell(values[names.index(joint)]) for joint in shown))
        if number:
            console.print()
        console.print(table)
    violations = answer["metrics"]["envelope_violations"]
    kept = "no envelope promised" if violations is None else f"samples outside the envelope: {violations}"
    timing = answer["timing"]
    error = answer["metrics"].get("tool_error")
    if error is not None:
        turn = answer["metrics"].get("tool_turn")
        turned = "" if turn is None else f" and {turn:.3g} rad"
        kept = f"{kept}, tool off by at most {error:.3g} m{turned}"
    console.print(
        f"\n{parts.scheme} on {parts.robot}: outcome {finished.outcome.kind}, {kept}; "
        f"{counted(int(finished.tally.samples), 'sample')} in {timing['run_s']:.2f} s, compiled in "
        f"{timing['compile_s']:.1f} s",
        soft_wrap=True,
    )


def print_comparison(rivals: Mapping[str, Rival]) -> None:
    """The metrics of several schemes, joint by joint, the least of each row in bold.

    Where the terminal is too narrow for all schemes, some of them follow in a table of their own.

    - `rivals`: each scheme with its run, by name.
    """
    from slidax.reports import standings

    console = Console(markup=False, highlight=False)
    first = next(iter(rivals.values()))
    joints = dict(zip(first.run.joint_names, short_names(first.run.joint_names), strict=True))
    rows = [row for row in standings(rivals, INDICES) if row.metric.brief]
    titles = {row.metric: f"{row.metric.title} [{row.unit}]" for row in reversed(rows)}
    widest = max(map(len, [*titles.values(), OUTSIDE]))
    console.print(first.scenario.description.title, style="bold", soft_wrap=True)
    for names in _fitting(list(rivals), console.width - widest):
        table = _table(widest, names)
        table.add_row("outcome", *(rivals[name].run.outcome.kind for name in names))
        table.add_row("form", *(rivals[name].form for name in names))
        table.add_row(
            "samples outside the envelope", *("-" if (n := rivals[name].outside) is None else str(n) for name in names)
        )
        metric: Metric[Any] | None = None
        for row in rows:
            if row.metric != metric:
                table.add_row(titles[row.metric])
            metric = row.metric
            table.add_row(f"  {joints[row.joint]}", *(_cell(row.values[name], name in row.best) for name in names))
        console.print(table)
        console.print()
    for name, rival in rivals.items():
        if not rival.run.outcome.ok:
            console.print(f"{name}: {rival.run.outcome.message}", soft_wrap=True)
    console.print(
        "Bold: the least of its row, among the runs that reached their end. Form: `printed` is a law as its source "
        "prints it, `sampled-data` one that is made for the period, with an estimator and limits.",
        soft_wrap=True,
    )


def _table(widest: int, columns: list[str]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("", no_wrap=True, min_width=widest)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True, min_width=WIDTH)
    return table


def _fitting(names: list[str], room: int) -> list[list[str]]:
    """The names in as few tables as fit, none much shorter than the others, and two characters between columns."""
    most = max(1, room // (max(WIDTH, *map(len, names)) + 2))
    tables = -(-len(names) // most)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _cell(value: float | None, best: bool = False) -> Text:
    return Text("-" if value is None else f"{value:.4g}", style="bold" if best else "")


def _titled(title: str, units: list[str]) -> str:
    said = ", ".join(dict.fromkeys(unit for unit in units if unit))
    return f"{title} [{said}]" if said else title


def print_study(found: AbstractResult) -> None:
    """The answer of a study, and its tables.

    - `found`: what was found.
    """
    console = Console(highlight=False)
    console.print(Text(found.lead), soft_wrap=True)
    for section in found.sections():
        if section.head:
            console.print()
            console.print(Text(section.title, style="bold"))
            if section.note:
                console.print(Text(section.note), soft_wrap=True)
            console.print(_section(section))


def _section(section: Section) -> Table:
    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(section.head):
        table.add_column(name, justify="left" if k == 0 or not name else "right")
    for row in section.rows:
        table.add_row(*(Text(_written(cell)) for cell in row))
    return table


def _written(cell: str | float | int | None) -> str:
    if cell is None:
        return "–"
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def print_certificates(found: Certificates) -> None:
    """What is promised in a table, then each certificate's statement, assumptions and remedies.

    - `found`: the certificates.
    """
    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False)
    for name in ("Promised", "holds", "grade", "margin", "bound"):
        table.add_column(name, justify="right" if name == "margin" else "left", overflow="fold")
    for one in found:
        bound = "; ".join(one.bound_in_words)
        answer = Text(one.answer, style=_style(one))
        table.add_row(Text(one.title), answer, one.grade or "", _cell(one.margin), Text(bound))
    console.print(Text(found.scenario, style="bold"))
    console.print(table)
    for one in found:
        console.print()
        console.print(Text(one.name, style="bold"), Text(one.answer, style=_style(one)))
        console.print(Text(f"  {one.statement}"), soft_wrap=True)
        for assumption in one.assumptions:
            style = "red" if assumption.status == "fails" else ""
            console.print(Text(f"  {assumption.status:>8}  {assumption.text}", style=style), soft_wrap=True)
        for remedy in one.remedies:
            said = f": {remedy.sets}" if remedy.changes else ""
            console.print(Text(f"    remedy  {remedy.words}{said}"), soft_wrap=True)


def print_loop(parts: Scenario, done: Looped) -> None:
    """The latencies of a loop in real time, what it missed, and whether the envelope was kept.

    - `parts`: what was run.
    - `done`: the loop.
    """
    console = Console(markup=False, highlight=False)
    console.print(parts.description.title, style="bold", soft_wrap=True)
    table = Table(box=None, pad_edge=False)
    table.add_column("time [µs]")
    found = done.percentiles()
    shares = list(next(iter(found.values()), {}))
    for share in shares:
        table.add_column(share, justify="right", min_width=WIDTH)
    for name, values in found.items():
        table.add_row(name, *(f"{1e6 * values[share]:.1f}" for share in shares))
    console.print(table)
    said = done.as_json()
    missed, bits = said["missed"], {name: count for name, count in done.statuses.items() if count}
    lines = [
        f"{done.ticks} ticks of {1e3 * done.period:g} ms, {done.answers} answers; {done.reason}",
        f"ticks without a command in time: {missed['ticks']}, at most {missed['longest']} in a row; answers taken back "
        f"as their command came late: {missed['rolled_back']}; measurements never answered: {missed['skipped']}",
        "status: " + (", ".join(f"{name} {count}" for name, count in bits.items()) or "always OK"),
    ]
    if done.margin is not None:
        lines.append(f"ticks outside the envelope: {done.outside}; least margin {min(done.margin):.3g} of its width")
    if done.size is not None:
        lines.append(f"log: {done.size / 1e6:.1f} MB; the recorder takes {1e6 * done.recorder:.1f} µs a tick")
    console.print("\n" + "\n".join(lines), soft_wrap=True)


def _style(one: Verdict) -> str:
    """Green if it holds, yellow if only from a time on, red if it does not hold."""
    if one.holds is None:
        return ""
    if not one.holds:
        return "bold red"
    return "green" if one.since is None else "yellow"
