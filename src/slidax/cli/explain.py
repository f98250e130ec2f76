"""`slidax explain`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json


def explain(
    run: Annotated[Path, typer.Argument(help="Folder or .mcap file that `slidax run` wrote with --out.")],
    json: AsJson = False,
    tries: Annotated[bool, typer.Option(help="Test the remedies in simulation.")] = True,
) -> None:
    """Explain why a run left its envelope: possible causes from its log, the likeliest first, each with a remedy.

    The likeliest remedies are tested in simulation until one keeps the run inside; its cause then comes first. If the
    log lacks samples, the scenario is simulated again.

    Exit code 0: diagnosed; 2: there is no such run, or its scheme cannot be diagnosed.
    """
    with errors_as_lines():
        prepare()
        from slidax.diagnosis import Record, explained, read_saved, require_explainable

        scenario, columns, full = read_saved(run)
        require_explainable(scenario)
        record = Record.of_columns(scenario, columns) if full else Record.of(scenario, scenario.simulate(log_every=1))
        answers = explained(scenario, record, tries=tries)
        if json:
            print_json({"causes": [answer.as_json() for answer in answers]})
            return
        if not answers:
            reason = "the run stayed inside its envelope" if record.kept else "the log shows none of the known causes"
            typer.echo(f"Nothing to explain: {reason}.")
        for number, answer in enumerate(answers, 1):
            typer.echo(f"{number}. {answer.sentence()}")
