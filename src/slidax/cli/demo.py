"""`slidax demo` and `slidax reproduce`."""

from __future__ import annotations

import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .common import errors_as_lines, prepare, say, say_where

if TYPE_CHECKING:
    from rich.console import Console

    from slidax.report.comparison import Rival

SCENARIO = "example-4.1-1khz"

LAWS: dict[str, dict[str, Any]] = {
    "CFTSMPPC": {},
    "CFTSMPPC as printed": {"scheme.sampled_data": None},
    "computed torque + PD": {"scheme.name": "computed_torque", "scheme.sampled_data": None},
}
"""The compared laws by title, each with its changes to the scenario."""

PLAYED = 1.5
"""Playing time of a run [s]."""

FRAMES = 30

INTRODUCTION = (
    "The law's model of the arm is 20 % off. A disturbance acts on the arm, torques are limited to 60 N m, and "
    "measurements are delayed by one period. The prescribed envelope for each joint's error narrows from 0.8 and "
    "0.6 rad to 0.002 rad in 6 s. Errors inside are blue, outside red; the scale is logarithmic except near zero.\n"
)

REMARK = (
    "\nThe first law is designed for its sample time, the others are as printed in their sources. With the same "
    "estimator and limits computed torque stays inside, too; the envelope adds a guarantee before the run.\n"
)


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the page with all figures and numbers.")] = Path("slidax-demo"),
    still: Annotated[bool, typer.Option("--still", help="Draw the plots without animation.")] = False,
    look: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Play three runs of an arm in the terminal, in ten seconds, and write a page about them.

    See also `slidax reproduce` for the paper's results and `slidax compare` for other schemes and arms.
    """
    with errors_as_lines():
        prepare()
        from rich.console import Console

        # Fails before the runs if the folder cannot be written.
        out.mkdir(parents=True, exist_ok=True)
        console = Console(markup=False, highlight=False)
        console.print("A two-link arm, commanded at 1 kHz", style="bold")
        console.print(INTRODUCTION)
        rivals = _play(console, still or not console.is_terminal)
        _print_verdicts(console, rivals)
        console.print(REMARK)
        with console.status("writing the page"):
            from slidax.report.comparison import write_comparison

            page = write_comparison(rivals, out, command="slidax demo")
        say_where(out)
        if look:
            import webbrowser

            webbrowser.open(page.resolve().as_uri())
        say("Next: `slidax run panda-payload`, or `slidax new --robot my-arm.urdf` for your own arm")


def _play(console: Console, still: bool) -> dict[str, Rival]:
    """Simulate and draw each law; return the runs by the law's title."""
    from rich.live import Live

    with console.status("starting JAX"):
        from slidax.report.comparison import Rival
        from slidax.scenarios.load import load

        from .terminal_plot import funnel

    judge = load(SCENARIO)
    rivals: dict[str, Rival] = {}
    for title, changes in LAWS.items():
        with console.status(f"simulating {title}"):
            rivals[title] = Rival.simulated(load(SCENARIO, changes), judge, logged=True)
        envelope_run, run = next(iter(rivals.values())).run, rivals[title].run
        console.print(title, style="bold")
        if still:
            console.print(funnel(console, run, envelope_run, 1.0))
        else:
            with Live(console=console, refresh_per_second=60, transient=False) as live:
                for frame in range(1, FRAMES + 1):
                    live.update(funnel(console, run, envelope_run, frame / FRAMES), refresh=True)
                    time.sleep(PLAYED / FRAMES)
        if not run.outcome.ok:
            console.print(run.outcome.message, style="red")
    return rivals


def _print_verdicts(console: Console, rivals: dict[str, Rival]) -> None:
    import numpy as np
    from rich.table import Table

    from slidax.analysis.metrics import steady_error, steady_torque_step

    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for head in ("samples outside", "steady error [rad]", "torque step [N m]"):
        table.add_column(head, justify="right")
    for title, rival in rivals.items():
        run = rival.run
        if run.outcome.kind == "ok":
            worst = [np.asarray(metric(run), dtype=float).max() for metric in (steady_error, steady_torque_step)]
            numbers = [f"{value:.2g}" for value in worst]
            table.add_row(title, f"{rival.outside} of {int(run.tally.samples)}", *numbers)
        else:
            end = "infinite" if run.outcome.kind == "not_finite" else "ended"
            table.add_row(title, f"{end} at {run.outcome.t:.2f} s", "-", "-")
    console.print(table)


Disturbance = StrEnum("Disturbance", ["stated", "off", "both"])
"""Disturbance of the paper's examples: as stated, switched off, or both."""


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report and results.json.")] = Path("reproduction"),
    disturbance: Annotated[
        Disturbance, typer.Option(help="Disturbance of the examples: as stated, off, or both.")
    ] = Disturbance.both,
) -> None:
    """Compute the paper's figures and tables, and compare them with the printed ones in a report."""
    with errors_as_lines():
        prepare()
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        from slidax import paper

        console = Console(stderr=True)
        columns = (TextColumn("{task.description:<44}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task("starting", total=1.0)
            results = paper.reproduce(
                out,
                disturbance=disturbance.value,
                progress=lambda stage, done: bar.update(task, description=stage, completed=done),
            )
        for reading, count in results["counts"].items():
            kinds = ", ".join(f"{number} {'differ' if kind == 'differs' else kind}" for kind, number in count.items())
            say(f"Printed values and statements, {results['readings'][reading]}: {kinds}.")
        say_where(out)
