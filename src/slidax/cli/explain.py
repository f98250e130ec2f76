"""`slidax explain`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json


def explain(
    run: Annotated[Path, typer.Argument(help="The folder or the .mcap file that a run has written by --out.")],
    json: AsJson = False,
    tries: Annotated[bool, typer.Option(help="Try the remedies in simulation.")] = True,
) -> None:
    """Why a run left its envelope: the causes that its log shows, the likeliest first, each with a remedy.

    The remedies of the likeliest causes are tried in simulation, until the run holds with one; that cause is the first.
    Where the log has not each sample, the scenario is run again to have them.

    Exit code 0: whatever was found; 2: there is no such run, or its scheme cannot be diagnosed.
    """
    with errors_as_lines():
        prepare()
        from slidax.diagnosis import Record, explained, read_saved, require_explainable

        scenario, columns, each = read_saved(run)
        require_explainable(scenario)
        record = Record.of_columns(scenario, columns) if each else Record.of(scenario, scenario.simulate(log_every=1))
        answers = explained(scenario, record, tries=tries)
        if json:
            print_json({"causes": [answer.as_json() for answer in answers]})
            return
        if not answers:
            kept = (
                "the run kept its envelope" if record.kept else "the log shows none of the causes that are looked for"
            )
            typer.echo(f"Nothing to explain: {kept}.")
        for number, answer in enumerate(answers, 1):
            typer.echo(f"{number}. {answer.sentence()}")
