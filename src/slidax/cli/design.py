"""`slidax design`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slidax._writing import write_text

from .certify import NOT_CERTIFIED
from .options import AsJson
from .session import errors_as_lines, prepare, print_json

if TYPE_CHECKING:
    from slidax.design import Designed


def design(
    requirements: Annotated[Path, typer.Argument(help="What the law must do, a YAML file.")],
    out: Annotated[Path, typer.Option(help="Write the scenario there, as YAML, and its certificate beside it.")],
    json: AsJson = False,
    runs: Annotated[int, typer.Option(help="Random cases of the check, and as many of a search.", min=10)] = 1000,
) -> None:
    """Design a controller for an arm, its motion and its uncertainty, with certificates; or explain why none exists.

    What the certificates do not bound is tested in simulated cases of the set, and the file says which of both it is.

    Exit code 0: designed; 4: refused, with the reason and what would do; 2: the requirements are invalid.
    """
    with errors_as_lines():
        prepare()
        from slidax._errors import DefinitionError
        from slidax.design import Refused, read_problem
        from slidax.design import design as designed

        if out.suffix not in (".yaml", ".yml"):
            raise DefinitionError(f"a scenario file needs the ending .yaml; got `{out}`")
        asked = read_problem(requirements)
        if out.exists() and out.samefile(requirements):
            raise DefinitionError(f"`{out}` has the requirements; give another name")
        found = designed(asked, runs=runs, say=lambda what: typer.echo(f"... {what}", err=True))
        if isinstance(found, Refused):
            if json:
                print_json(found.as_json())
            else:
                typer.echo(f"Not designed: {found.reason}")
            raise typer.Exit(NOT_CERTIFIED)
        _tell(found, out, json)


def _tell(found: Designed, out: Path, json: bool) -> None:
    from slidax.certificates import Certificates, certify
    from slidax.design.text import called, write_design, written
    from slidax.scenarios import load

    typer.echo("... all certificates", err=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, written(found, out.parent))
    scenario = load(out)
    # Where it does not hold it is asked again, for what would do.
    known = () if found.rate is None or not found.rate.holds else (found.rate,)
    certificates = Certificates(scenario.name, (*certify(scenario, runs=0, known=known), found.check))
    beside = write_design(found, out, certificates)
    if json:
        answer = {
            "designed": True,
            "scenario": str(out),
            "certificate": str(beside),
            "proof": found.proof,
            **certificates.as_json(),
        }
        print_json(answer)
        return
    how = called(found.rate) if found.proof == "bound" else "tested in simulation, without a bound"
    final = ", ".join(f"{one:.3g}" for one in found.choice.final)
    typer.echo(f"Designed, {how}. The error is within {final} from {found.choice.deadline:g} s on.")
    typer.echo(
        f"Steady error {found.worst.error:.2g}, torque step {found.worst.step:.2g} N m, in the worst common case."
    )
    typer.echo(found.check.statement)
    if certificates.failing:
        typer.echo(f"Certificates that do not hold: {', '.join(certificates.failing)}.")
    typer.echo(f"The scenario is in {out}, its certificates in {beside}; next: slidax certify {out}")
