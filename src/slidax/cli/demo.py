"""`slidax demo`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .session import errors_as_lines, prepare, say_where

if TYPE_CHECKING:
    from rich.console import Console

    from slidax.reports import Rival

SCENARIO = "example-4.1-1khz"

LAWS: dict[str, dict[str, Any]] = {
    "CFTSMPPC": {},
    "CFTSMPPC as printed": {"scheme.sampled_data": None},
    "computed torque + PD": {"scheme.name": "computed_torque", "scheme.sampled_data": None},
}
"""What is shown, and how it differs from the scenario."""

PLAYED = 1.5
"""How long a run plays [s]."""

FRAMES = 30

WORDS = (
    "The law knows its arm with 20 % error; a disturbance shakes it, torques end at 60 N m, and measurements are one "
    "period old. Before the run an envelope is drawn for the error of each joint: it narrows from 0.8 and 0.6 rad to "
    "0.002 rad in 6 s. Blue is an error inside, red outside; the scale is logarithmic but about zero.\n"
)

HONEST = (
    "\nThe first law is made for its period, the others are as their sources print them. With the same estimator and "
    "limits computed torque stays inside, too: what the envelope adds is the promise, made beforehand.\n"
)


def demo(
    out: Annotated[Path, typer.Option(help="Where the page with all pictures and numbers goes.")] = Path("slidax-demo"),
    still: Annotated[bool, typer.Option("--still", help="Draw at once, without playing.")] = False,
    look: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """The law in ten seconds: three runs of an arm, played in the terminal, and a page about them.

    For the results of the paper there is `slidax reproduce`, for other schemes and arms `slidax compare`.
    """
    with errors_as_lines():
        prepare()
        from rich.console import Console

        # What cannot be written is said before the runs, not after them.
        out.mkdir(parents=True, exist_ok=True)
        console = Console(highlight=False)
        console.print("A two-link arm, commanded at 1 kHz", style="bold")
        console.print(WORDS)
        rivals = _played(console, still or not console.is_terminal)
        _print_verdicts(console, rivals)
        console.print(HONEST)
        with console.status("writing the page"):
            from slidax.reports import write_comparison

            page = write_comparison(rivals, out, command="slidax demo")
        say_where(out)
        if look:
            import webbrowser

            webbrowser.open(page.resolve().as_uri())
        typer.echo("Go on with `slidax run panda-payload`, or with an arm of yours: `slidax new --robot my-arm.urdf`")


def _played(console: Console, still: bool) -> dict[str, Rival]:
    """The runs, each drawn as soon as it is there."""
    from rich.live import Live

    with console.status("starting JAX"):
        from slidax.reports import Rival
        from slidax.scenarios import load

        from .funnel import funnel

    judge = load(SCENARIO)
    rivals: dict[str, Rival] = {}
    for title, changes in LAWS.items():
        with console.status(f"simulating {title}"):
            rivals[title] = Rival.simulated(load(SCENARIO, changes), judge, logged=True)
        drawn = next(iter(rivals.values())).run
        console.print(title, style="bold")
        if still:
            console.print(funnel(console, rivals[title].run, drawn, 1.0))
            continue
        with Live(console=console, refresh_per_second=60, transient=False) as live:
            for frame in range(1, FRAMES + 1):
                live.update(funnel(console, rivals[title].run, drawn, frame / FRAMES), refresh=True)
                time.sleep(PLAYED / FRAMES)
    return rivals


def _print_verdicts(console: Console, rivals: dict[str, Rival]) -> None:
    import numpy as np
    from rich.table import Table

    from slidax.metrics import steady_error, steady_torque_step

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
            table.add_row(title, f"{run.outcome.kind.replace('_', ' ')} at {run.outcome.t:.2f} s", "-", "-")
    console.print(table)
