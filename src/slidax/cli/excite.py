"""`slidax excite`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson, Gravity, Inertias, Locked, Tip, named_arm
from .session import errors_as_lines, prepare, print_json


def excite(
    robot: Annotated[str, typer.Argument(help="A built-in arm by name, or a URDF, MJCF or YAML file.")],
    out: Annotated[Path, typer.Option(help="CSV file for the motion.")],
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
    duration: Annotated[float, typer.Option(help="Duration of the motion [s]: two periods.")] = 20.0,
    harmonics: Annotated[int, typer.Option(help="Number of harmonics of the base frequency.")] = 10,
    share: Annotated[float, typer.Option(help="Share of the limits to use at most.")] = 0.8,
    acceleration: Annotated[
        float | None,
        typer.Option(help="Largest acceleration [rad/s²]; default: three times the largest velocity per second."),
    ] = None,
    payload: Annotated[float, typer.Option(help="Largest payload [kg] that the torque limits must allow.")] = 0.0,
    links: Annotated[bool, typer.Option("--links", help="Excite the links' inertial parameters, too.")] = False,
    tip: Tip = None,
    gravity: Gravity = None,
    inertias: Inertias = None,
    locked: Locked = None,
    json: AsJson = False,
) -> None:
    """Compute an excitation motion for an arm's rotors, friction and payload, from rest to rest within its limits.

    A scenario runs it with `trajectory: {kind: csv, file: motion.csv}`. Collisions are not checked: simulate the motion
    first.
    """
    with errors_as_lines():
        prepare()
        from slidax import identification
        from slidax._errors import as_array
        from slidax.robots import Payload

        arm, _ = named_arm(robot, tip, inertias, locked, gravity)
        carried = Payload(mass=as_array(payload)) if payload else None
        motion = identification.excite(
            arm,
            seed=seed,
            duration=duration,
            harmonics=harmonics,
            share=share,
            acceleration=acceleration,
            payload=carried,
            links=links,
        )
        motion.write(out)
        if json:
            print_json(motion.as_json())
            return
        typer.echo(str(motion))
        typer.echo(f"The motion is in {out.resolve()}")
