"""Results of commands as tables for people and JSON for programs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from slidax.analysis.index_sums import INDEX_SUMS
from slidax.analysis.metric import short_names
from slidax.analysis.metrics import envelope_violations, metrics_of, summary
from slidax.analysis.run_verdict import run_verdict
from slidax.core.errors import count_noun

from .common import columns, wrapped

if TYPE_CHECKING:
    from slidax.analysis.metric import Metric
    from slidax.analysis.run_verdict import RunVerdict
    from slidax.certify.certificate import Verdict
    from slidax.certify.certify import Certificates
    from slidax.certify.motion.admission import MotionAdmission
    from slidax.certify.motion.certified_law import CertifiedLaw
    from slidax.design.speed_table import SpeedRow
    from slidax.export.real_time_loop import LoopResult
    from slidax.report.comparison import Rival
    from slidax.scenarios.scenario import Scenario
    from slidax.simulation.run import Run
    from slidax.studies.study import AbstractResult, Section

OUTSIDE = envelope_violations.title
WIDTH = 9
"""Width of a number in a table [characters], as of `1.234e-05`."""


def run_as_json(parts: Scenario, finished: Run, import_s: float) -> dict[str, Any]:
    """Return the output of `slidax run --json`.

    - `parts`, `finished`: the scenario and its run.
    - `import_s`: start-up time [s].
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
        "metrics": summary(finished, INDEX_SUMS),
        "timing": {
            "import_s": round(import_s, 4),
            "compile_s": round(timing.compile_s, 4) if timing else None,
            "run_s": round(timing.run_s, 4) if timing else None,
            "steps": round(parts.t1 / parts.period),
        },
    }


def print_run(parts: Scenario, finished: Run, answer: dict[str, Any], *, every: bool = False) -> None:
    """Print the verdict of one run, then its metrics joint by joint.

    A narrow terminal gets several tables with some of the joints each.

    - `parts`, `finished`: the scenario and its run.
    - `answer`: from `run_as_json`.
    - `every`: True for all metrics, False for the most important ones.
    """
    rows: list[tuple[str, list[float | None]]] = []
    for metric in (*metrics_of(finished), *INDEX_SUMS):
        if not (metric.per_joint and metric.source in parts.description.source and (every or metric.brief)):
            continue
        values = metric.shown(finished)
        if any(value is not None for value in values) or metric.needs_settling:
            rows.append((_titled(metric.title, metric.units(finished)), values))
    console = Console(markup=False, highlight=False)
    _say(console, parts.description.title, style="bold")
    _print_verdict(console, run_verdict(parts, finished))
    names = short_names(finished.joint_names)
    widest = max(len(title) for title, _ in rows)
    for shown in _fitting(names, console.width - widest):
        table = _table(widest, shown)
        for title, values in rows:
            table.add_row(title, *(_cell(values[names.index(joint)]) for joint in shown))
        console.print()
        console.print(table)
    violations = answer["metrics"]["envelope_violations"]
    envelope = "" if violations is None else f"{violations} outside the envelope; "
    timing = answer["timing"]
    console.print()
    _say(
        console,
        f"{parts.scheme} on {parts.arm_name}: {count_noun(int(finished.tally.samples), 'sample')}, {envelope}"
        f"simulated in {timing['run_s']:.2f} s, compiled in {timing['compile_s']:.1f} s",
    )


def _print_verdict(console: Console, verdict: RunVerdict) -> None:
    sign, style = ("✓", "bold green") if verdict.good else ("✗", "bold red")
    _say(console, f"{sign} {verdict.sentence}", style=style, hang=2)
    for fact in verdict.facts:
        _say(console, fact, margin="  ")


def _say(console: Console, text: str, *, style: str = "", margin: str = "", hang: int = 0) -> None:
    """Print a sentence as `say` does, with a style."""
    lines = wrapped(text, columns(sys.stdout), margin, hang)
    console.print(Text(lines, style=style), soft_wrap=True)


def print_comparison(rivals: Mapping[str, Rival]) -> None:
    """Print which schemes stay inside the envelope and which of these are best, then each scheme's metrics by joint.

    The least value of a row is bold, among the runs that reached their end. A narrow terminal gets several tables
    with some of the schemes each.

    - `rivals`: the runs, by name of the scheme.
    """
    from slidax.report.comparison import comparison_verdict, standings

    console = Console(markup=False, highlight=False)
    first = next(iter(rivals.values()))
    joints = dict(zip(first.run.joint_names, short_names(first.run.joint_names), strict=True))
    rows = [row for row in standings(rivals, INDEX_SUMS) if row.metric.brief]
    titles = {row.metric: f"{row.metric.title} [{row.unit}]" for row in reversed(rows)}
    widest = max(map(len, [*titles.values(), OUTSIDE]))
    _say(console, first.scenario.description.title, style="bold")
    _print_verdict(console, comparison_verdict(rivals))
    console.print()
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
            _say(console, f"{name}: {rival.run.outcome.message}", hang=2)
    _say(
        console,
        "Bold: the least value of a row, among the runs that reached their end. Form: `printed` is a law as its source "
        "prints it, `sampled-data` one for the sample time, with an estimator and limits.",
    )


def _table(widest: int, columns: list[str]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("", no_wrap=True, min_width=widest)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True, min_width=WIDTH)
    return table


def _fitting(names: list[str], width: int) -> list[list[str]]:
    """Split column names into as few tables as fit a `width` [characters], with nearly equal numbers of columns."""
    most = max(1, width // (max(WIDTH, *map(len, names)) + 2))
    tables = -(-len(names) // most)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _cell(value: float | None, best: bool = False) -> Text:
    return Text("-" if value is None else digits_of(value), style="bold" if best else "")


def digits_of(value: float, digits: int = 4) -> str:
    """Return a number as text with so many significant `digits`; numbers from 1 to 10 million have no exponent."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def _titled(title: str, units: list[str]) -> str:
    unit = ", ".join(dict.fromkeys(unit for unit in units if unit))
    return f"{title} [{unit}]" if unit else title


def print_study(result: AbstractResult) -> None:
    """Print the `result` of a study with its tables."""
    console = Console(markup=False, highlight=False)
    _say(console, result.summary)
    for section in result.sections():
        if section.head:
            console.print()
            console.print(Text(section.title, style="bold"))
            if section.note:
                _say(console, section.note)
            console.print(_section(section))


def _section(section: Section) -> Table:
    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(section.head):
        table.add_column(name, justify="left" if k == 0 or not name else "right")
    for row in section.rows:
        table.add_row(*(Text(_written(cell)) for cell in row))
    return table


def _written(cell: str | float | int | None) -> str:
    if cell is None or cell != cell:
        return "–"
    return digits_of(cell) if isinstance(cell, float) else str(cell)


def print_certificates(certificates: Certificates, *, every: bool = False) -> None:
    """Print the verdict on all `certificates`, then each that applies: its statement, failed assumptions and remedies.

    - `every`: True for all assumptions, and the reasons of certificates that do not apply.
    """
    console = Console(markup=False, highlight=False)
    console.print(Text(certificates.scenario, style="bold"))
    console.print(certificates_verdict(certificates))
    for verdict in certificates:
        if verdict.holds is None and not every:
            continue
        sign = {True: "✓", False: "✗", None: "-"}[verdict.holds]
        since = f" {verdict.answer}" if verdict.since is not None else ""
        facts = [verdict.name]
        if verdict.grade:
            facts.append(f"grade {verdict.grade}: {verdict.stands_on}")
        if verdict.margin is not None:
            facts.append(f"margin {100 * verdict.margin:.3g} %")
        console.print()
        console.print(Text(f"{sign} {verdict.title}{since}", style=_style(verdict) or "bold"))
        console.print(Text(wrapped("; ".join(facts), console.width, "  "), style="dim"))
        console.print(Text(wrapped(verdict.statement, console.width, "  ")))
        for assumption in verdict.assumptions:
            if every or assumption.status == "fails":
                style = "red" if assumption.status == "fails" else ""
                console.print(
                    Text(wrapped(f"{assumption.status}: {assumption.text}", console.width, "    ", 2), style=style)
                )
        for remedy in verdict.remedies:
            # A command to copy is not wrapped.
            changes = f": {remedy.sets}" if remedy.changes else ""
            console.print(Text(f"    remedy: {remedy.words}{changes}"), soft_wrap=True)
    absent = [verdict.name for verdict in certificates if verdict.holds is None]
    if absent and not every:
        console.print()
        _say(console, f"Not applicable: {', '.join(absent)}.")
    if not every:
        _say(console, "`--long` prints every assumption and the reason why a certificate does not apply.")


def certificates_verdict(certificates: Certificates) -> Text:
    """The verdict on all `certificates` in a sentence."""
    if certificates.failing:
        return Text(f"✗ {certificates.summary}", style="bold red")
    return Text(f"✓ {certificates.summary}", style="bold green" if certificates.since is None else "bold yellow")


def print_admissions(
    law: CertifiedLaw, admissions: Sequence[MotionAdmission], monitor: dict[str, list[float]] | None
) -> None:
    """Print for each motion if it is admitted or why not, and its error bound; then the monitor's setting.

    - `law`: the certified law, for the joints' names and units.
    - `admissions`: the decisions.
    - `monitor`: result of `monitor_setting`; None if no motion is admitted.
    """
    console = Console(markup=False, highlight=False)
    for answer in admissions:
        grade = f" (grade {answer.verdict.grade})" if answer.admitted else ""
        words, style = ("admitted", "green") if answer.admitted else ("not admitted", "bold red")
        console.print(Text(f"{answer.name}: "), Text(words, style=style), Text(grade), sep="", soft_wrap=True)
        if answer.limit is not None:
            _say(console, str(answer.limit), margin="  ")
            slower = "not admitted even 4" if answer.slow_down is None else f"admitted {answer.slow_down:.3g}"
            _say(console, f"{slower} times slower", margin="  ")
        if answer.bound is not None:
            joint = int(answer.bound.argmax())
            _say(
                console,
                f"error at most {answer.bound[joint]:.3g} {law.arm.joint_units[joint]}, in "
                f"`{law.arm.joint_names[joint]}`, mostly by {answer.dominant}",
                margin="  ",
            )
        for assumption in answer.verdict.assumptions:
            style = "red" if assumption.status == "fails" else ""
            _say(console, f"{assumption.status:<8}  {assumption.text}", style=style, margin="  ", hang=10)
    if monitor is not None:
        console.print(Text(f"scheme.sampled_data.monitor: {{disturbance: {monitor['disturbance']}}}"), soft_wrap=True)


def print_speeds(rows: Sequence[SpeedRow]) -> None:
    """Print a table of error bounds [rad or m]; each row has the same random motions at another speed.

    The column "certified" counts the motions with a bound within the final radius and the torque limits, and "torque
    steps" those of them that also keep the torque rate limit.
    """
    console = Console(markup=False, highlight=False)
    motions = count_noun(rows[0].motions, "motion")
    console.print(
        f"Error bounds of the worst joint [rad or m], along {motions} from rest to rest between random postures. "
        "`certified` motions have a bound within the final radius and keep the torque limits; `torque steps` counts "
        "those of them that also keep the torque rate limit:"
    )
    table = Table(box=None, pad_edge=False)
    for name in ("speed", "certified", "torque steps", "median", "largest", "mostly by"):
        table.add_column(name, justify="left" if name == "mostly by" else "right", overflow="fold")
    for row in rows:
        bounds = ("-" if bound is None else f"{bound:.3g}" for bound in (row.median, row.largest))
        table.add_row(f"{100 * row.speed:.0f} %", f"{row.certified}", f"{row.steps}", *bounds, row.reason)
    console.print(table)


def print_loop(parts: Scenario, result: LoopResult) -> None:
    """Print latencies, missed ticks and the margin to the envelope.

    - `parts`: the scenario.
    - `result`: result of its real-time loop.
    """
    console = Console(markup=False, highlight=False)
    _say(console, parts.description.title, style="bold")
    table = Table(box=None, pad_edge=False)
    table.add_column("time [µs]")
    latencies = result.percentiles()
    shares = list(next(iter(latencies.values()), {}))
    for share in shares:
        table.add_column(share, justify="right", min_width=WIDTH)
    for name, values in latencies.items():
        table.add_row(name, *(f"{1e6 * values[share]:.1f}" for share in shares))
    console.print(table)
    missed, statuses = result.as_json()["missed"], {name: count for name, count in result.statuses.items() if count}
    lines = [
        f"{result.ticks} ticks of {1e3 * result.period:g} ms, {result.answers} answers; {result.reason}",
        f"ticks without a command: {missed['ticks']}, at most {missed['longest']} in a row; steps undone because of a "
        f"delayed command: {missed['rolled_back']}; unanswered measurements: {missed['skipped']}",
        "status: " + (", ".join(f"{name} {count}" for name, count in statuses.items()) or "always OK"),
    ]
    if result.margin is not None:
        lines.append(
            f"ticks outside the envelope: {result.outside}; least margin {min(result.margin):.3g} of its width"
        )
    if result.size is not None:
        lines.append(f"log: {result.size / 1e6:.1f} MB; the recorder takes {1e6 * result.recorder:.1f} µs a tick")
    console.print()
    for line in lines:
        _say(console, line)


def _style(verdict: Verdict) -> str:
    """Green if the certificate holds, yellow if it holds only after some time, red if it fails."""
    if verdict.holds is None:
        return ""
    if not verdict.holds:
        return "bold red"
    return "green" if verdict.since is None else "yellow"
