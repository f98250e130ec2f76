"""`slidax identify`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json, say_note, say_where

Robot = Annotated[str, typer.Option(help="A ready arm by its name, or a URDF, MJCF or YAML file.")]
Topic = Annotated[
    str | None, typer.Option(help="The topic of the joint states, where a log has several.", metavar="NAME")
]
Columns = Annotated[
    list[str] | None,
    typer.Option(
        metavar="QUANTITY=COLUMN",
        help="Which columns are which quantity: t, q, dq or tau, by the word in their titles (q=position,tau=effort) "
        "or by a title for each joint (tau=a,b,c); repeatable.",
    ),
]
Drop = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Leave out a quantity (dq), a column, or a joint by its name or number in the log; repeatable.",
    ),
]
Tip = Annotated[str | None, typer.Option(help="The link, body or site of the tip, where a file has several ends.")]


def identify(
    log: Annotated[
        Path,
        typer.Argument(help="Positions and torques: .csv, .parquet, .mcap, a ros2 bag, or JointState as .json(l)."),
    ],
    robot: Robot,
    out: Annotated[Path | None, typer.Option(help="Write the arm with its uncertainties there, as YAML.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Write a report with figures there.")] = None,
    tip: Tip = None,
    topic: Topic = None,
    columns: Columns = None,
    drop: Drop = None,
    links: Annotated[bool, typer.Option("--links", help="Identify the links' inertial parameters, too.")] = False,
    rotors: Annotated[bool, typer.Option(help="Whether the torques are measured where rotors show.")] = True,
    payload: Annotated[bool | None, typer.Option(help="Whether what the tip carries is unknown.")] = None,
    asymmetric: Annotated[bool, typer.Option("--asymmetric", help="Viscous friction differs by direction.")] = False,
    cut_off: Annotated[
        float | None, typer.Option(help="Filter cut-off [Hz]; chosen from the log if not given.")
    ] = None,
    held_out: Annotated[float, typer.Option(help="The last share of the log, predicted and not fitted.")] = 0.25,
    json: AsJson = False,
) -> None:
    """Rotor inertia, friction, payload and perhaps the links of an arm, from a log of its positions and torques.

    Each number has a standard error, and what the log does not show is said. A scenario takes the written file as
    `robot: {kind: identified, file: arm.yaml}`.
    """
    with errors_as_lines():
        prepare()
        from slidax import identification
        from slidax.scenarios import named_robot

        arm, description = named_robot(robot, tip=tip)
        record = identification.read_log(
            log,
            arm.joint_names,
            topic=topic,
            columns=identification.parse_columns(columns or []),
            drop=drop or [],
        )
        for note in record.notes:
            say_note(f"{record.source}: {note}")
        found = identification.identify(
            record,
            arm,
            rotors=rotors,
            payload=payload,
            links=links,
            asymmetric=asymmetric,
            cut_off=cut_off,
            held_out=held_out,
        )
        if out is not None:
            identification.write_arm(found, description, out)
        if report is not None:
            from slidax.reports import write_identification_report

            write_identification_report(found, report, command=shlex.join(["slidax", *sys.argv[1:]]))
        if json:
            print_json(found.as_json())
            return
        typer.echo(str(found))
        if out is not None:
            typer.echo(f"The arm is in {out.resolve()}")
        if report is not None:
            say_where(report)
