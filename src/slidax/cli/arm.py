"""Commands about arms: `new`, `excite`, `identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .common import (
    AsJson,
    Gravity,
    Inertias,
    Locked,
    Tip,
    command_line,
    errors_as_lines,
    named_arm,
    numbers,
    positions,
    prepare,
    print_json,
    say,
    say_note,
    say_warning,
    say_where,
)


def new(
    robot: Annotated[
        str, typer.Option(help="A URDF or MJCF file, a built-in arm, or a module of robot_descriptions by name.")
    ],
    rate: Annotated[float, typer.Option(help="Sampling rate of the controller [Hz].")] = 1000.0,
    out: Annotated[Path | None, typer.Option(help="YAML file for the scenario; default: print it.")] = None,
    payload: Annotated[
        float, typer.Option(help="Mass at the tip [kg] that the controller does not know.", min=0.0)
    ] = 0.0,
    tip: Annotated[
        str | None, typer.Option(help="Link, body or site of the tip; default: found automatically.")
    ] = None,
    inertias: Inertias = None,
    locked: Locked = None,
    gravity: Gravity = None,
    requirements: Annotated[
        bool, typer.Option("--requirements", help="Write a requirements file for `slidax design` instead.")
    ] = False,
) -> None:
    """Write a commented scenario that runs, for any arm.

    Home position, motion, torques, envelope and estimator follow from the arm's data. Missing data and placeholders,
    such as 300 N m on every joint, are replaced by assumptions, which are printed and written into the file. Grippers,
    cameras and heads are locked. `slidax excite` and `slidax identify` take the written file as their robot.
    """
    with errors_as_lines():
        prepare()
        from slidax.core.errors import DefinitionError
        from slidax.core.writing import write_text
        from slidax.scenarios.draft import draft

        if out is not None and out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"the file needs the ending .yaml; got `{out}`")
        if out is not None and out.exists():
            raise DefinitionError(f"`{out}` exists already: give another name, or remove it")
        scenario = draft(
            robot,
            rate,
            tip=tip,
            locked=positions("--locked", locked or []),
            inertias=inertias,
            gravity=None if gravity is None else numbers("--gravity", gravity),
            payload=payload,
            requirements=requirements,
            folder=Path() if out is None else out.parent,
        )
        if out is None:
            typer.echo(scenario.text, nl=False)
        else:
            write_text(out, scenario.text)
        for note in scenario.notes:
            say(f"assumed: {note}", err=True, hang=2)
        if out is not None and requirements:
            law = out.with_name(f"{out.stem}-law.yaml")
            say(f"The requirements are in {out}; next: `slidax design {out} --out {law}`", err=True)
        elif out is not None:
            say(f"The scenario is in {out}; next: `slidax run {out}`", err=True)


def excite(
    robot: Annotated[str, typer.Argument(help="A built-in arm by name, or a URDF, MJCF or YAML file.")],
    out: Annotated[Path, typer.Option(help="CSV file for the motion.")],
    seed: Annotated[int, typer.Option(help="Random seed.")] = 0,
    duration: Annotated[float, typer.Option(help="Duration of the motion [s]: two periods.")] = 20.0,
    harmonics: Annotated[int, typer.Option(help="Number of harmonics of the base frequency.")] = 10,
    share: Annotated[float, typer.Option(help="Largest share of the arm's limits that the motion uses.")] = 0.8,
    acceleration: Annotated[
        float | None,
        typer.Option(help="Acceleration limit [rad/s² or m/s²]; default: 3/s times the velocity limit."),
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
        from slidax import identify
        from slidax.arms.arm import Payload
        from slidax.core.errors import as_array

        arm, _ = named_arm(robot, tip, inertias, locked, gravity)
        carried = Payload(mass=as_array(payload)) if payload else None
        motion = identify.excite(
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


UNITS = "Units, signs and joint order of the log"
Robot = Annotated[str, typer.Option(help="A built-in arm by name, or a URDF, MJCF or YAML file.")]
Topic = Annotated[str | None, typer.Option(help="Topic of the joint states, if a log has several.", metavar="NAME")]
Columns = Annotated[
    list[str] | None,
    typer.Option(
        metavar="QUANTITY=COLUMN",
        help="Columns of a quantity (t, q, dq or tau), by a word in their titles (q=position) "
        "or by a title for each joint (tau=a,b,c); repeatable.",
    ),
]
Drop = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Omit a quantity (dq), a column, or a joint by its name or number in the log; repeatable.",
    ),
]


def identify(
    log: Annotated[
        list[Path],
        typer.Argument(
            help="Positions and torques: .csv, .parquet, .mcap, a ros2 bag, or JointState as .json(l); or several logs."
        ),
    ],
    robot: Robot,
    load: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KG@X,Y,Z",
            help="Load of each log, in their order: none, unknown, or a mass [kg] with its centre in the tip's frame "
            "[m], optionally with @ and its inertia [kg m²]; it adds to the arm's own payload.",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="YAML file for the identified arm with its uncertainty.")] = None,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for a report with figures.")] = None,
    tip: Tip = None,
    topic: Topic = None,
    columns: Columns = None,
    drop: Drop = None,
    links: Annotated[bool, typer.Option("--links", help="Identify the links' inertial parameters, too.")] = False,
    rotors: Annotated[
        bool, typer.Option(help="Identify rotor inertias; torques measured behind the gears lack them.")
    ] = True,
    payload: Annotated[bool | None, typer.Option(help="Identify the payload; default: unless --links is set.")] = None,
    payload_as: Annotated[
        str | None,
        typer.Option(
            metavar="FORM",
            help="Print the payload in the format of a robot: ur (URScript), franka (libfranka), desk (Franka Desk), "
            "kuka (KRL) or urdf.",
        ),
    ] = None,
    asymmetric: Annotated[
        bool, typer.Option("--asymmetric", help="Identify viscous friction for each direction.")
    ] = False,
    stribeck: Annotated[
        float | None, typer.Option(help="Identify Stribeck friction with this Stribeck velocity [rad/s].")
    ] = None,
    ripple: Annotated[
        str | None, typer.Option(metavar="N,...", help="Identify torque ripple with these periods per turn.")
    ] = None,
    encoder_offset: Annotated[
        bool, typer.Option("--encoder-offset", help="Identify the offset of each encoder's zero.")
    ] = False,
    actuator_map: Annotated[
        str | None,
        typer.Option(metavar="FORM", help="Identify the drives' gains (gain), or also their cross-talk (full)."),
    ] = None,
    cut_off: Annotated[
        float | None, typer.Option(help="Cut-off frequency of the filter [Hz]; default: from the log.")
    ] = None,
    held_out: Annotated[float, typer.Option(help="Share of the log, at its end, held out for validation.")] = 0.25,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Gravity in the base frame [m/s²], for an arm on a wall or ceiling; the word `identify`: find its "
            "direction from the log.",
        ),
    ] = None,
    inertias: Inertias = None,
    locked: Locked = None,
    time_unit: Annotated[
        str, typer.Option(help="s, ms, us, ns, or seconds per unit, such as 0.004.", rich_help_panel=UNITS)
    ] = "s",
    position_unit: Annotated[
        str | None,
        typer.Option(help="rad, deg, mrad or rev; m or mm if a joint is prismatic.", rich_help_panel=UNITS),
    ] = None,
    position_sign: Annotated[
        str | None, typer.Option(metavar="LIST", help="1 or -1 for each joint.", rich_help_panel=UNITS)
    ] = None,
    position_offset: Annotated[
        str | None, typer.Option(metavar="LIST", help="Added to the positions [rad or m].", rich_help_panel=UNITS)
    ] = None,
    torque_unit: Annotated[
        str, typer.Option(help="Nm, mNm, Ncm, kNm, kgfm, kgfcm, lbfft, lbfin or ozfin.", rich_help_panel=UNITS)
    ] = "Nm",
    torque_scale: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Factors of the torques, such as N m per ampere.", rich_help_panel=UNITS),
    ] = None,
    torque_sign: Annotated[
        str | None, typer.Option(metavar="LIST", help="1 or -1, for all joints or for each.", rich_help_panel=UNITS)
    ] = None,
    add_gravity: Annotated[
        bool,
        typer.Option("--add-gravity", help="Add gravity torques, which the log's torques lack.", rich_help_panel=UNITS),
    ] = False,
    torque_delay: Annotated[
        float, typer.Option(help="Delay of the torques relative to the positions [s].", rich_help_panel=UNITS)
    ] = 0.0,
    joint_order: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Arm joint for each joint of the log.", rich_help_panel=UNITS),
    ] = None,
    position_order: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Arm joint for each position of the log.", rich_help_panel=UNITS)
    ] = None,
    torque_order: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Arm joint for each torque of the log.", rich_help_panel=UNITS)
    ] = None,
    ignore_torque: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT", help="Do not use the torque of a joint; repeatable.", rich_help_panel=UNITS),
    ] = None,
    json: AsJson = False,
) -> None:
    """Identify rotor inertia, friction, payload and optionally the links of an arm from logs of positions and torques.

    Each parameter has a standard error. The log is first checked against the arm: time unit, gaps, gravity, and sign,
    scale and joint order of the torques. An error names the option that corrects it. A scenario reads the result with
    `robot: {kind: identified, file: arm.yaml}`. Several logs are fitted together; options on the log apply to all.

        slidax identify log.csv --robot panda --torque-unit mNm --out arm.yaml
        slidax identify a.csv b.csv --load none --load 2@0,0,0.1 --robot panda --links --payload --actuator-map gain
    """
    with errors_as_lines():
        prepare()
        from slidax import identify as identification

        if payload_as is not None:
            identification.require_payload_form(payload_as)
        tilted = gravity == "identify"
        arm, description = named_arm(robot, tip, inertias, locked, None if tilted else gravity)
        loads = None if load is None else [identification.parse_load(text) for text in load]
        conventions = identification.Conventions(
            time_unit=time_unit,
            position_unit=_words(position_unit),
            position_sign=numbers("--position-sign", position_sign or "1"),
            position_offset=numbers("--position-offset", position_offset or "0"),
            torque_unit=torque_unit,
            torque_scale=numbers("--torque-scale", torque_scale or "1"),
            torque_sign=numbers("--torque-sign", torque_sign or "1"),
            add_gravity=add_gravity,
            torque_delay=torque_delay,
            joint_order=_words(joint_order),
            position_order=_words(position_order),
            torque_order=_words(torque_order),
            ignore_torque=ignore_torque or [],
        )
        records = [
            identification.read_log(
                path,
                arm.joint_names,
                topic=topic,
                columns=identification.parse_columns(columns or []),
                drop=drop or [],
            )
            for path in log
        ]
        for record in records:
            for note in record.notes:
                say_note(f"{record.source}: {note}")
        result = identification.identify(
            records,
            arm,
            loads=loads,
            conventions=conventions,
            rotors=rotors,
            payload=payload,
            links=links,
            asymmetric=asymmetric,
            stribeck=stribeck,
            ripple=numbers("--ripple", ripple) if ripple else [],
            encoder_offset=encoder_offset,
            actuator_map=actuator_map,
            gravity=tilted,
            cut_off=cut_off,
            held_out=held_out,
        )
        if json:
            for warning in result.warnings:
                say_warning(warning)
        if out is not None:
            identification.write_arm(result, description, out)
        if report is not None:
            from slidax.report.pages import write_identification_report

            write_identification_report(result, report, command=command_line())
        if json:
            print_json(result.as_json())
            return
        for line in str(result).splitlines():
            say(line, hang=2)
        if payload_as is not None:
            typer.echo(identification.payload_text(result.robot.payload, payload_as))
        if out is not None:
            typer.echo(f"The arm is in {out.resolve()}")
        if report is not None:
            say_where(report)


def _words(text: str | None) -> list[str]:
    return [word.strip() for word in text.split(",")] if text else []
