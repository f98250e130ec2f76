"""`slidax design`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .certify import NOT_CERTIFIED
from .options import AsJson
from .session import errors_as_lines, prepare, print_json

if TYPE_CHECKING:
    from slidax.design import Designed


def design(
    requirements: Annotated[Path, typer.Argument(help="The requirements, a YAML file.")],
    out: Annotated[Path, typer.Option(help="Write the scenario there, as YAML, and its certificates next to it.")],
    json: AsJson = False,
    runs: Annotated[int, typer.Option(help="Random cases of the check, and as many of a search.", min=10)] = 1000,
) -> None:
    """Design a controller for an arm, its motion and its uncertainty, with certificates; or explain why none exists.

    Simulated cases of the uncertainty set test everything without a certified bound; the file states which applies.

    Exit code 0: designed; 4: refused, with the reason and remedies; 2: the requirements are invalid.
    """
    with errors_as_lines():
        prepare()
        from slidax._errors import DefinitionError
        from slidax.design import Refused, read_problem
        from slidax.design import design as designed

        if out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"a scenario file needs the ending .yaml; got `{out}`")
        problem = read_problem(requirements)
        if out.exists() and out.samefile(requirements):
            raise DefinitionError(f"`{out}` is the requirements file: write the scenario to another file")
        result = designed(problem, runs=runs, say=lambda step: typer.echo(f"... {step}", err=True))
        if isinstance(result, Refused):
            if json:
                print_json(result.as_json())
            else:
                typer.echo(f"Not designed: {result.reason}")
            raise typer.Exit(NOT_CERTIFIED)
        _write(result, out, json)


def _write(result: Designed, out: Path, json: bool) -> None:
    from slidax.certificates import Certificates, certify
    from slidax.design.text import called, write_design

    typer.echo("... all certificates", err=True)
    scenario = result.description.build(out.stem)
    # A bound that does not hold is computed again, for its remedies.
    known = () if result.rate is None or not result.rate.holds else (result.rate,)
    certificates = Certificates(scenario.name, (*certify(scenario, runs=0, known=known), result.check))
    path = write_design(result, out, certificates)
    if json:
        answer = {
            "designed": True,
            "scenario": str(out),
            "certificate": str(path),
            "proof": result.proof,
            **certificates.as_json(),
        }
        print_json(answer)
        return
    proof = called(result.rate) if result.proof == "bound" else "tested in simulation, without a bound"
    final = ", ".join(f"{radius:.3g}" for radius in result.choice.final)
    typer.echo(f"Designed, {proof}. The error is within {final} from {result.choice.deadline:g} s on.")
    typer.echo(
        f"Steady error {result.worst.error:.2g}, torque step {result.worst.step:.2g} N m, in the worst common case."
    )
    typer.echo(result.check.statement)
    if certificates.failing:
        typer.echo(f"Certificates that do not hold: {', '.join(certificates.failing)}.")
    typer.echo(f"The scenario is in {out}, its certificates in {path}; next: slidax certify {out}")
