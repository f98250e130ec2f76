"""`slidax linear`."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Changes, Named
from .session import errors_as_lines, parsed, prepare, print_json, say_where

if TYPE_CHECKING:
    from slidax.linear import Linear
    from slidax.scenarios import Scenario

UNSTABLE = 4
"""Exit code where the loop is not stable."""

PLACES = {"torque": "Broken at the torque, each joint:", "measurement": "Broken at the measured position:"}

SHOWN = 8
"""Modes in the table: the slowest."""


def linear(
    scenario: Named,
    changes: Changes = None,
    at: Annotated[float | None, typer.Option(help="Time in the run [s]; its end if not given.")] = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Write a page, Bode and Nyquist figures, linear.json there.")] = None,
) -> None:
    """The sampled loop near a point of its run, linearised: eigenvalues, margins of each joint, peaks of sensitivity.

    What is linearised is the very sample that is simulated, with estimator, delay and drives. Rounding, noise and lost
    samples are left out and learning stands still, which is said.

    Exit code 0: the loop is stable there; 4: it is not; 2: the scenario is invalid, or its run ends before that time.
    """
    with errors_as_lines():
        prepare()
        from slidax.linear import linearise
        from slidax.scenarios import load

        started = time.perf_counter()
        parts = load(scenario, parsed(changes or []))
        found = linearise(parts, at)
        if out is not None:
            from slidax.reports import write_linear_report

            seconds = time.perf_counter() - started
            write_linear_report(parts, found, out, seconds=seconds, command=shlex.join(["slidax", *sys.argv[1:]]))
        if json:
            print_json(found.as_json())
        else:
            _print(parts, found)
            if out is not None:
                say_where(out)
        if not found.stable:
            raise typer.Exit(UNSTABLE)


def _print(parts: Scenario, found: Linear) -> None:
    from rich.console import Console
    from rich.text import Text

    from slidax.metrics import short_names

    console = Console(markup=False, highlight=False)
    console.print(parts.description.title, style="bold", soft_wrap=True)
    verdict = "stable" if found.stable else "NOT stable"
    console.print(
        f"near t = {found.at:g} s: {verdict}, spectral radius {found.system.radius:.6g}, "
        f"{found.system.a.shape[0]} states",
        soft_wrap=True,
    )
    rows = [
        [f"{z:.4f}" if z.imag else f"{z.real:.4f}", _number(omega), _number(damping)]
        for z, omega, damping in found.modes[:SHOWN]
    ]
    console.print(_table(["slowest eigenvalues", "[rad/s]", "damping"], rows))
    period = found.system.period
    for where, title in (
        ("torque", "Broken at the torque, each joint:"),
        ("measurement", "Broken at the measured position:"),
    ):
        margins = found.margins(where) if found.held else None
        if margins is None:
            continue
        names = short_names(found.joint_names)
        rows = [
            [
                name,
                *map(_number, (one.gain_up, one.gain_down, one.phase)),
                _periods(one.delay, period),
                *map(_number, (one.disk, one.sensitivity, one.at_peak)),
            ]
            for name, one in zip(names, margins, strict=True)
        ]
        every = found.together(where)
        if every is not None:
            rows.append(["all at once", "", "", "", "", *map(_number, every)])
        head = ["", "gain up", "down", "phase °", "delay/h", "disk", "peak S", "rad/s"]
        console.print(f"\n{title}")
        console.print(_table(head, rows))
    if not found.held:
        console.print("continuous mode: the torque follows within a period, so that no sampled loop can be broken open")
    for note in found.notes:
        console.print(Text(f"  {note}"), soft_wrap=True)


def _table(head: list[str], rows: list[list[str]]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _periods(delay: float | None, period: float) -> str:
    return _number(None if delay is None else delay / period)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
