"""`slidax loop`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Changes, Named
from .session import OUTCOME, errors_as_lines, parsed, prepare, print_json, say_warning

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

MovedBy = StrEnum("MovedBy", ["auto", "mujoco", "own"])
"""What moves the arm."""

PORT = 8765
"""Where Foxglove looks first."""


def loop(
    scenario: Named,
    changes: Changes = None,
    seconds: Annotated[float | None, typer.Option("--time", help="Duration [s]; the scenario's if not given.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Write a log there.")] = None,
    arm: Annotated[MovedBy, typer.Option(help="What moves the arm; `auto`: MuJoCo, if it can.")] = MovedBy.auto,
    hog: Annotated[bool, typer.Option("--cpu-hog", help="Keep all processors busy beside it.")] = False,
    patience: Annotated[int, typer.Option(help="Ticks without a command until the arm brakes.", min=1)] = 20,
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve live data to Foxglove on this machine.")] = False,
    port: Annotated[int, typer.Option(help="Port of the Foxglove server.", min=1, max=65535)] = PORT,
    histogram: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw the latencies.")] = None,
    json: AsJson = False,
) -> None:
    """The exported step in real time: law and arm in two processes, each woken by the clock, a third writes the log.

    The arm does not wait. A command that comes late is not taken: the last torque stands, and the law is told so by the
    next measurement. After some ticks without a command the arm brakes; without measurements the law ends.

    What the system allows (real-time priority, memory that stays) is asked for, and said where it is not granted.

    Exit code 0: it reached its end inside its envelope, whatever was missed; 2: the scenario is invalid; 3: the
    envelope was left, or a side stopped.
    """
    with errors_as_lines():
        prepare()
        from slidax.deploy.robot_loop import run_loop
        from slidax.scenarios import load
        from slidax.terminal import print_loop

        values = parsed(changes or [])
        if seconds is not None:
            values["simulation.t1"] = seconds
        parts = _moved(load(scenario, values), arm)
        if foxglove:
            typer.echo(f"Live data: Foxglove, open connection, ws://127.0.0.1:{port}", err=True)
        done = run_loop(
            parts, log=out, port=port if foxglove else None, patience=patience, hogs=_processors() if hog else 0
        )
        if histogram is not None:
            from slidax.figures import latencies, save

            save(latencies(done.times, done.period), histogram)
        for said in done.not_granted():
            say_warning(said)
        if json:
            print_json({"scenario": parts.name, "arm": parts.description.simulation.plant, **done.as_json()})
        else:
            print_loop(parts, done)
            if out is not None:
                typer.echo(f"The log is in {out.resolve()}")
        if not done.good:
            raise typer.Exit(OUTCOME)


def _moved(parts: Scenario, by: Any) -> Scenario:
    """The scenario with its arm moved by MuJoCo or by ourselves."""
    from importlib.util import find_spec

    from slidax._errors import DefinitionError
    from slidax.robots import Articulated
    from slidax.scenarios import altered

    if by == MovedBy.own:
        return altered(parts, {"simulation.plant": "own"})
    able = isinstance(parts.plant.robot, Articulated) and find_spec("mujoco") is not None
    if by == MovedBy.mujoco and not able:
        raise DefinitionError(
            "MuJoCo moves an articulated arm, if it is installed (pip install 'slidax[robots]'): `--arm own`"
        )
    load = parts.plant.load
    steady = load is None or (float(load.attached) <= 0 and float(load.released) >= parts.t1)
    return altered(parts, {"simulation.plant": "mujoco"}) if able and (steady or by == MovedBy.mujoco) else parts


def _processors() -> int:
    import os

    return os.cpu_count() or 1
