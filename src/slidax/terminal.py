"""What the commands print of their runs: tables for a person, JSON for a program."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from slidax.metrics import summary

if TYPE_CHECKING:
    from slidax.scenarios import Scenario
    from slidax.simulation import Run

COMPARED = {
    "settling_time.1e-3": "settled to |e| <= 1e-3",
    "settling_time.1e-5": "settled to |e| <= 1e-5",
    "steady_error": "steady error",
    "peak_torque": "peak torque",
    "max_torque_step": "torque step, max",
    "steady_torque_step": "torque step, steady",
    "iae": "IAE (80)",
    "eci": "ECI (81)",
    "aice": "AICE (82)",
}
"""The metrics that a comparison shows on the terminal; its report shows all."""


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
        "metrics": summary(finished),
        "timing": {
            "import_s": round(import_s, 4),
            "compile_s": round(timing.compile_s, 4) if timing else None,
            "run_s": round(timing.run_s, 4) if timing else None,
            "steps": round(parts.t1 / parts.period),
        },
    }


def print_run(parts: Scenario, finished: Run, answer: dict[str, Any]) -> None:
    """The metrics of one run, joint by joint, and what came of it.

    Where the terminal is too narrow for all joints, some of them follow in a table of their own.

    - `parts`: what was simulated.
    - `finished`: the run.
    - `answer`: what `slidax run --json` prints of it.
    """
    metrics = answer["metrics"]
    length, torque = _joined(finished.joint_units), _joined(parts.plant.robot.torque_units)
    end = (int(finished.tally.samples) - 1) * parts.period
    rows: list[tuple[str, list[float | None] | None]] = [
        (f"settled to |e| <= {band} [s]", [value if value < end else None for value in values])
        for band, values in metrics["settling_time"].items()
    ]
    rows += [
        (f"steady error [{length}]", metrics["steady_error"]),
        (f"peak torque [{torque}]", metrics["peak_torque"]),
        (f"initial torque [{torque}]", metrics["initial_torque"]),
        (f"torque step, max [{torque}]", metrics["max_torque_step"]),
        (f"torque step, steady [{torque}]", metrics["steady_torque_step"]),
        (f"torque step, steady, rms [{torque}]", metrics["steady_torque_step_rms"]),
        ("IAE (80)", metrics["iae"]),
        ("ECI (81)", metrics["eci"]),
        ("AICE (82)", metrics["aice"]),
        ("envelope margin [of its width]", metrics["envelope_margin"]),
    ]
    console = Console(markup=False, highlight=False)
    console.print(parts.description.title, style="bold", soft_wrap=True)
    names = [f"joint {joint + 1}" for joint in range(finished.joints)]
    widest = max(len(name) for name, _ in rows)
    for number, shown in enumerate(_fitting(names, console.width - widest)):
        table = Table(box=None, pad_edge=False)
        table.add_column("", no_wrap=True, min_width=widest)
        for name in shown:
            table.add_column(name, justify="right", no_wrap=True, min_width=9)
        for name, values in rows:
            if values is not None:
                cells = [values[names.index(joint)] for joint in shown]
                table.add_row(name, *("-" if value is None else f"{value:.4g}" for value in cells))
        if number:
            console.print()
        console.print(table)
    violations = metrics["envelope_violations"]
    kept = "no envelope promised" if violations is None else f"samples outside the envelope: {violations}"
    timing = answer["timing"]
    console.print(
        f"\n{parts.scheme} on {parts.robot}: outcome {finished.outcome.kind}, {kept}; "
        f"{int(finished.tally.samples)} samples in {timing['run_s']:.2f} s, compiled in {timing['compile_s']:.1f} s",
        soft_wrap=True,
    )


def print_comparison(scenario_runs: Mapping[str, tuple[Scenario, Run]]) -> None:
    """The metrics of several schemes, joint by joint, the least of each row in bold.

    Where the terminal is too narrow for all schemes, some of them follow in a table of their own.

    - `scenario_runs`: each scheme's scenario and finished run, by name.
    """
    from slidax.reports import Row, standings

    console = Console(markup=False, highlight=False)
    rows = [row for row in standings(scenario_runs) if row.metric in COMPARED]
    labels = {id(row): f"{COMPARED[row.metric]}, joint {row.joint} [{row.unit}]" for row in rows}
    room = console.width - max(map(len, labels.values()))
    console.print(next(iter(scenario_runs.values()))[0].description.title, style="bold", soft_wrap=True)
    for names in _fitting(list(scenario_runs), room):
        table = Table(box=None, pad_edge=False)
        table.add_column("", no_wrap=True)
        for name in names:
            table.add_column(name, justify="right", no_wrap=True)
        table.add_row("outcome", *(scenario_runs[name][1].outcome.kind for name in names))
        previous: Row | None = None
        for row in rows:
            if previous is not None and row.metric != previous.metric:
                table.add_row()
            table.add_row(labels[id(row)], *(_cell(row.values[name], name in row.best) for name in names))
            previous = row
        console.print(table)
        console.print()
    for name, (_, run) in scenario_runs.items():
        if not run.outcome.ok:
            console.print(f"{name}: {run.outcome.message}", soft_wrap=True)
    console.print("Bold: the least of its row, among the runs that reached their end.", soft_wrap=True)


def _fitting(names: list[str], room: int) -> list[list[str]]:
    """The names in as few tables as fit, each column two wider than what stands in it."""
    tables: list[list[str]] = [[]]
    left = room
    for name in names:
        width = max(len(name), 9) + 2
        if tables[-1] and width > left:
            tables.append([])
            left = room
        tables[-1].append(name)
        left -= width
    return tables


def _cell(value: float | None, best: bool) -> Text:
    return Text("-" if value is None else f"{value:.4g}", style="bold" if best else "")


def _joined(units: tuple[str, ...]) -> str:
    return units[0] if len(set(units)) == 1 else ", ".join(units)
