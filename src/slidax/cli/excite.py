"""`slidax excite`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson, Gravity, Inertias, Locked, Tip, named_arm
from .session import errors_as_lines, prepare, print_json


def excite(
    robot: Annotated[str, typer.Argument(help="A ready arm by its name, or a URDF, MJCF or YAML file.")],
    out: Annotated[Path, typer.Option(help="Write the motion there, as CSV.")],
    seed: Annotated[int, typer.Option(help="Random seed; the same seed gives the same motion.")] = 0,
    duration: Annotated[float, typer.Option(help="Duration of the motion [s]: two periods.")] = 20.0,
    harmonics: Annotated[int, typer.Option(help="Multiples of the base frequency.")] = 10,
    share: Annotated[float, typer.Option(help="Largest share of the limits that is used.")] = 0.8,
    acceleration: Annotated[
        float | None,
        typer.Option(help="Largest acceleration [rad/s²]; three times the largest velocity per second if not given."),
    ] = None,
    payload: Annotated[float, typer.Option(help="Largest payload [kg] that the torque limits must allow.")] = 0.0,
    links: Annotated[bool, typer.Option("--links", help="Show the links' inertial parameters, too.")] = False,
    tip: Tip = None,
    gravity: Gravity = None,
    inertias: Inertias = None,
    locked: Locked = None,
    json: AsJson = False,
) -> None:
    """A motion that shows an arm's rotors, friction and payload best, from rest to rest and within its limits.

    A scenario takes it as `trajectory: {kind: csv, file: motion.csv}`. Collisions are not looked at: watch the motion
    first.
    """
    with errors_as_lines():
        prepare()
        from slidax import identification
        from slidax._errors import as_array
        from slidax.robots import Payload

        arm, _ = named_arm(robot, tip, inertias, locked, gravity)
        carried = Payload(mass=as_array(payload)) if payload else None
        found = identification.excite(
            arm,
            seed=seed,
            duration=duration,
            harmonics=harmonics,
            share=share,
            acceleration=acceleration,
            payload=carried,
            links=links,
        )
        found.write(out)
        if json:
            print_json(found.as_json())
            return
        typer.echo(str(found))
        typer.echo(f"The motion is in {out.resolve()}")
