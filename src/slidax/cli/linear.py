"""`slidax linear`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Changes, Named
from .session import command_line, errors_as_lines, parsed, prepare, print_json, say_where

if TYPE_CHECKING:
    from slidax.linear import Linear
    from slidax.scenarios import Scenario

UNSTABLE = 4
"""Exit code if the loop is unstable."""

SHOWN = 8
"""Slowest modes in the table."""


def linear(
    scenario: Named,
    changes: Changes = None,
    at: Annotated[float | None, typer.Option(help="Time in the run [s]; default: its end.")] = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Folder for a report, Bode and Nyquist plots, linear.json.")] = None,
) -> None:
    """Linearise the sampled loop at a time of its run: eigenvalues, stability margins of each joint, sensitivity peaks.

    The simulated step is linearised with estimator, delay and drives. Rounding, noise and lost samples are omitted and
    the adaptation is frozen, as the output states.

    Exit code 0: the loop is stable there; 4: it is unstable; 2: the scenario is invalid, or its run ends earlier.
    """
    with errors_as_lines():
        prepare()
        from slidax.linear import linearise
        from slidax.scenarios import load

        started = time.perf_counter()
        parts = load(scenario, parsed(changes or []))
        loop = linearise(parts, at)
        if out is not None:
            from slidax.reports import write_linear_report

            seconds = time.perf_counter() - started
            write_linear_report(parts, loop, out, seconds=seconds, command=command_line())
        if json:
            print_json(loop.as_json())
        else:
            _print(parts, loop)
            if out is not None:
                say_where(out)
        if not loop.stable:
            raise typer.Exit(UNSTABLE)


def _print(parts: Scenario, loop: Linear) -> None:
    from rich.console import Console
    from rich.text import Text

    from slidax.metrics import short_names

    console = Console(markup=False, highlight=False)
    console.print(parts.description.title, style="bold", soft_wrap=True)
    verdict = "stable" if loop.stable else "NOT stable"
    console.print(
        f"near t = {loop.at:g} s: {verdict}, spectral radius {loop.system.radius:.6g}, {loop.system.a.shape[0]} states",
        soft_wrap=True,
    )
    rows = [
        [f"{z:.4f}" if z.imag else f"{z.real:.4f}", _number(omega), _number(damping)]
        for z, omega, damping in loop.modes[:SHOWN]
    ]
    console.print(_table(["slowest eigenvalues", "[rad/s]", "damping"], rows))
    for where, title in (
        ("torque", "Broken at the torque, each joint:"),
        ("measurement", "Broken at the measured position:"),
    ):
        margins = loop.margins(where) if loop.held else None
        if margins is None:
            continue
        names = short_names(loop.joint_names)
        rows = [
            [
                name,
                *map(_number, (margin.gain_up, margin.gain_down, margin.phase)),
                _number(None if margin.delay is None else margin.delay / loop.system.period),
                *map(_number, (margin.disk, margin.sensitivity, margin.at_peak)),
            ]
            for name, margin in zip(names, margins, strict=True)
        ]
        together = loop.together(where)
        if together is not None:
            rows.append(["all at once", "", "", "", "", *map(_number, together)])
        head = ["", "gain up", "down", "phase °", "delay/h", "disk", "peak S", "rad/s"]
        console.print(f"\n{title}")
        console.print(_table(head, rows))
    if not loop.held:
        console.print("continuous mode: the torque follows within a period, so there is no sampled loop to break open")
    for note in loop.notes:
        console.print(Text(f"  {note}"), soft_wrap=True)


def _table(head: list[str], rows: list[list[str]]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
