"""`slidax loop`."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Changes, Named
from .session import OUTCOME, errors_as_lines, parsed, prepare, print_json, say_warning

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

Simulator = StrEnum("Simulator", ["auto", "mujoco", "own"])
"""Simulator of the arm."""

PORT = 8765
"""Foxglove's default port."""


def loop(
    scenario: Named,
    changes: Changes = None,
    seconds: Annotated[float | None, typer.Option("--time", help="Duration [s]; default: the scenario's.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Write a log.")] = None,
    arm: Annotated[Simulator, typer.Option(help="Arm simulator; `auto`: MuJoCo, if possible.")] = Simulator.auto,
    hog: Annotated[bool, typer.Option("--cpu-hog", help="Load all processors in the meantime.")] = False,
    patience: Annotated[int, typer.Option(help="Ticks without a command until the arm brakes.", min=1)] = 20,
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve live data to Foxglove on this machine.")] = False,
    port: Annotated[int, typer.Option(help="Port of the Foxglove server.", min=1, max=65535)] = PORT,
    histogram: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw the latencies.")] = None,
    json: AsJson = False,
) -> None:
    """Run the exported step in real time: law and arm in two processes on the same clock, and a third for the log.

    The arm does not wait. It ignores a delayed command and keeps the last torque; the next measurement reports this to
    the law. After several ticks without a command the arm brakes; without measurements the law stops.

    Real-time priority and locked memory are requested from the system; a warning names those that it refuses.

    Exit code 0: the run ended inside its envelope, also with missed ticks; 2: the scenario is invalid; 3: the run left
    its envelope, or a process stopped.
    """
    with errors_as_lines():
        prepare()
        from slidax.deploy.robot_loop import run_loop
        from slidax.scenarios import load
        from slidax.terminal import print_loop

        values = parsed(changes or [])
        if seconds is not None:
            values["simulation.t1"] = seconds
        parts = _with_simulator(load(scenario, values), arm)
        if foxglove:
            typer.echo(f"Live data: Foxglove, open connection, ws://127.0.0.1:{port}", err=True)
        result = run_loop(
            parts, log=out, port=port if foxglove else None, patience=patience, hogs=(os.cpu_count() or 1) if hog else 0
        )
        if histogram is not None:
            from slidax.figures import latencies, save

            save(latencies(result.times, result.period), histogram)
        for refusal in result.not_granted():
            say_warning(refusal)
        if json:
            print_json({"scenario": parts.name, "arm": parts.description.simulation.plant, **result.as_json()})
        else:
            print_loop(parts, result)
            if out is not None:
                typer.echo(f"The log is in {out.resolve()}")
        if not result.good:
            raise typer.Exit(OUTCOME)


def _with_simulator(parts: Scenario, by: Any) -> Scenario:
    """The scenario with its arm simulated by MuJoCo or by slidax."""
    from importlib.util import find_spec

    from slidax._errors import DefinitionError
    from slidax.robots import Articulated
    from slidax.scenarios import altered

    if by == Simulator.own:
        return altered(parts, {"simulation.plant": "own"})
    possible = isinstance(parts.plant.robot, Articulated) and find_spec("mujoco") is not None
    if by == Simulator.mujoco and not possible:
        raise DefinitionError(
            "MuJoCo needs an articulated arm and its package (pip install 'slidax[robots]'): use `--arm own`"
        )
    load = parts.plant.load
    steady = load is None or (float(load.attached) <= 0 and float(load.released) >= parts.t1)
    return altered(parts, {"simulation.plant": "mujoco"}) if possible and (steady or by == Simulator.mujoco) else parts
