"""Commands about control laws: `certify`, `admit`, `design`, `linear`."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .common import (
    AsJson,
    Changes,
    Named,
    columns,
    command_line,
    errors_as_lines,
    parse_changes,
    prepare,
    print_json,
    say,
    say_where,
    stage_bar,
    wrapped,
)

NOT_CERTIFIED = 4
"""Exit code if a certificate does not hold."""


def certify(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
    long: Annotated[bool, typer.Option("--long", help="Print every assumption.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for a report with figures and certificate.json.")] = None,
    runs: Annotated[int, typer.Option(help="Runs of the statistical certificate; 0 omits it.", min=0)] = 300,
    seed: Annotated[int, typer.Option(help="Random seed of these runs.", min=0)] = 0,
) -> None:
    """Certify a scenario before it runs: guarantees with their bounds, margins and assumptions.

    An assumption is `proved` (for the whole uncertainty set, up to rounding), `tested` (in the named cases), `assumed`
    (unchecked) or `fails`. Grade A: all are proved; B: some; C: none. The scenario's block `uncertainty` defines the
    set of arms, payloads and initial states.

    Exit code 0: every applicable certificate holds; 4: one does not hold; 2: the scenario is invalid.
    """
    with errors_as_lines():
        prepare()
        from slidax.certify.certify import certify as certified
        from slidax.scenarios.load import load

        from .tables import print_certificates

        started = time.perf_counter()
        parts = load(scenario, parse_changes(changes or []))
        with stage_bar() as begin:
            certificates = certified(parts, runs=runs, seed=seed, begin=begin)
        if out is not None:
            from slidax.report.pages import write_certificate_report

            seconds = time.perf_counter() - started
            write_certificate_report(parts, certificates, out, seconds=seconds, command=command_line())
        if json:
            print_json(certificates.as_json())
        else:
            print_certificates(certificates, every=long)
            if out is not None:
                say_where(out)
        if not certificates.holds:
            raise typer.Exit(NOT_CERTIFIED)


def admit(
    motions: Annotated[
        list[Path],
        typer.Argument(help="Files of motions: CSV of joints or tool poses, or JointTrajectory as JSON or YAML."),
    ],
    scenario: Annotated[
        str, typer.Option(help="Scenario of the law, with its uncertainty: built-in name or YAML file.")
    ],
    within: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Largest allowed error [rad or m]; default: the scenario's tolerance, otherwise any."
        ),
    ] = None,
    assume_steps: Annotated[
        bool,
        typer.Option(
            "--assume-steps",
            help="Also admit a motion if only its feedback torque might reach the torque rate limit.",
        ),
    ] = False,
    slow_down: Annotated[
        bool,
        typer.Option(
            "--slow-down/--no-slow-down", help="Search for the smallest slow-down that admits a refused motion."
        ),
    ] = True,
    changes: Changes = None,
    json: AsJson = False,
) -> None:
    """Decide if motions are inside a law's guarantee: for all arms of its uncertainty set, without a simulation.

    The output has for each motion the bound of every joint's error, and the term that dominates this bound. For a
    refused motion it also has the reason, and the smallest slow-down with which the motion is admitted. For all
    admitted motions together, it has a setting with which the law's monitor raises no alarm on any arm of the set.

    Exit code 0: all are admitted; 4: at least one is refused; 2: the law has no such guarantee, or a file is invalid.
    """
    with errors_as_lines():
        prepare()
        import numpy as np

        from slidax.certify.motion.admission import admit as admitted
        from slidax.certify.motion.admission import allowed_error, certified_law, monitor_setting, piecewise
        from slidax.core.errors import locate_errors
        from slidax.scenarios.load import load
        from slidax.scenarios.trajectories import motion_of_file

        from .tables import print_admissions

        parts = load(scenario, parse_changes(changes or []))
        law = certified_law(parts)
        allowed = allowed_error(parts) if within is None else within
        start = np.asarray(parts.state0.q, float).tolist()
        answers = []
        for path in motions:
            with locate_errors(f"`{path}`"):
                motion = piecewise(motion_of_file(path, law.arm, start))
            answers.append(
                admitted(law, motion, str(path), allowed=allowed, assume_steps=assume_steps, slow_down=slow_down)
            )
        if json:
            print_json({"motions": [answer.as_json() for answer in answers], "monitor": monitor_setting(answers)})
        else:
            print_admissions(law, answers, monitor_setting(answers))
        if not all(answer.admitted for answer in answers):
            raise typer.Exit(NOT_CERTIFIED)


if TYPE_CHECKING:
    from slidax.design.design import DesignResult


def design(
    requirements: Annotated[Path, typer.Argument(help="The requirements, a YAML file.")],
    out: Annotated[Path, typer.Option(help="YAML file for the scenario; its certificates are written next to it.")],
    json: AsJson = False,
    runs: Annotated[
        int,
        typer.Option(help="Number of random cases in the check; a search for the worst case takes as many.", min=10),
    ] = 1000,
) -> None:
    """Design a controller for an arm, its motion and its uncertainty, with certificates; or explain why none exists.

    Every design is tested in simulated cases of the uncertainty set. If possible its error bound is also certified; the
    scenario states which applies.

    Exit code 0: designed; 4: refused, with the reason and remedies; 2: the requirements are invalid.
    """
    with errors_as_lines():
        prepare()
        from slidax.core.errors import DefinitionError
        from slidax.design.design import design as designed
        from slidax.design.problem import read_problem
        from slidax.design.refusal import Refusal

        if out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"a scenario file needs the ending .yaml; got `{out}`")
        problem = read_problem(requirements)
        if out.exists() and out.samefile(requirements):
            raise DefinitionError(f"`{out}` is the requirements file: write the scenario to another file")
        started = time.perf_counter()
        result = designed(
            problem,
            runs=runs,
            say=lambda step: typer.echo(f"... {step} ({time.perf_counter() - started:.0f} s so far)", err=True),
        )
        if isinstance(result, Refusal):
            if json:
                print_json(result.as_json())
            else:
                say(f"Not designed: {result.reason}")
            raise typer.Exit(NOT_CERTIFIED)
        _write(result, out, json)


def _write(result: DesignResult, out: Path, json: bool) -> None:
    from slidax.certify.certify import Certificates, certify
    from slidax.design.design import name_proof, write_design

    typer.echo("... all certificates", err=True)
    scenario = result.description.build(out.stem)
    known = () if result.bound is None else (result.bound,)
    with stage_bar() as begin:
        verdicts = certify(scenario, runs=0, known=known, begin=begin)
    certificates = Certificates(scenario.name, (*verdicts, result.check))
    path = write_design(result, out, certificates)
    if json:
        answer = {
            "designed": True,
            "scenario": str(out),
            "certificate": str(path),
            "proof": result.proof,
            **({"speeds": [row.as_json() for row in result.speeds]} if result.speeds else {}),
            **certificates.as_json(),
        }
        print_json(answer)
        return
    proof = name_proof(result.bound) if result.proof == "bound" else "tested in simulation, without a bound"
    units = scenario.plant.robot.joint_units
    length = " or ".join(dict.fromkeys(units))
    torque = " or ".join(dict.fromkeys("N m" if unit == "rad" else "N" for unit in units))
    radii = [f"{radius:.3g} {unit}" for radius, unit in zip(result.choice.final, units, strict=True)]
    final = ", ".join(radii if len(set(radii)) > 1 else radii[:1])
    say(f"Designed, {proof}. The error is within {final} from {result.choice.deadline:g} s on.")
    say(
        f"Steady error {result.worst.error:.2g} {length}, torque step {result.worst.step:.2g} {torque}, in the worst "
        "of the cases in which all candidate designs were simulated."
    )
    say(result.check.statement)
    if result.speeds:
        from .tables import print_speeds

        print_speeds(result.speeds)
    if certificates.failing:
        say(f"Certificates that do not hold: {', '.join(certificates.failing)}.")
    say(f"The scenario is in {out}, its certificates in {path}; next: `slidax certify {out}`")


if TYPE_CHECKING:
    from slidax.analysis.linearise import LinearisedLoop
    from slidax.scenarios.scenario import Scenario

UNSTABLE = 4
"""Exit code if the loop is unstable."""

SHOWN = 8
"""Number of slowest modes in the table."""


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

    Exit code 0: the loop is stable at this time; 4: it is unstable; 2: invalid scenario, or its run ends earlier.
    """
    with errors_as_lines():
        prepare()
        from slidax.analysis.linearise import linearise
        from slidax.scenarios.load import load

        started = time.perf_counter()
        parts = load(scenario, parse_changes(changes or []))
        loop = linearise(parts, at)
        if out is not None:
            from slidax.report.pages import write_linear_report

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


def _print(parts: Scenario, loop: LinearisedLoop) -> None:
    from rich.console import Console

    from slidax.analysis.metric import short_names

    console = Console(markup=False, highlight=False)
    width = columns(sys.stdout)
    console.print(wrapped(parts.description.title, width), style="bold", soft_wrap=True)
    verdict = "stable" if loop.stable else "NOT stable"
    say(f"near t = {loop.at:g} s: {verdict}, spectral radius {loop.system.radius:.6g}, {loop.system.a.shape[0]} states")
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
        together = loop.simultaneous_margins(where)
        if together is not None:
            rows.append(["all at once", "", "", "", "", *map(_number, together)])
        head = ["", "gain up", "down", "phase °", "delay/h", "disk", "peak S", "rad/s"]
        console.print(f"\n{title}")
        console.print(_table(head, rows))
    if not loop.held:
        say("continuous mode: the torque changes within a period, so a sampled loop with margins does not exist")
    for note in loop.notes:
        say(note, margin="  ")


def _table(head: list[str], rows: list[list[str]]) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(head):
        table.add_column(name, justify="left" if k == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _number(value: float | None) -> str:
    from .tables import digits_of

    return "-" if value is None else digits_of(value, 3)
