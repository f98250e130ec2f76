"""`slidax certify`."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson, Changes, Named
from .session import errors_as_lines, parsed, prepare, print_json, say_where

NOT_CERTIFIED = 4
"""Exit code where a certificate does not hold."""


def certify(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Write a page, its figures and certificate.json there.")] = None,
    runs: Annotated[int, typer.Option(help="Runs of the statistical certificate; 0 leaves it out.", min=0)] = 300,
    seed: Annotated[int, typer.Option(help="Random seed of these runs.", min=0)] = 0,
) -> None:
    """What is promised of a scenario before it runs: each promise with its bound, its margin and what it stands on.

    A line is `proved` (for the whole set, up to rounding), `tested` (in the cases that it names), `assumed` (nothing
    was done for it) or `fails`. Grade A: all lines are proved; B: some; C: none. The scenario's block `uncertainty`
    says for which arms, loads and starts it is asked.

    Exit code 0: each certificate that applies holds; 4: one does not; 2: the scenario is invalid.
    """
    with errors_as_lines():
        prepare()
        from slidax.certificates import certify as certified
        from slidax.scenarios import load
        from slidax.terminal import print_certificates

        started = time.perf_counter()
        parts = load(scenario, parsed(changes or []))
        found = certified(parts, runs=runs, seed=seed)
        if out is not None:
            from slidax.reports import write_certificate_report

            seconds = time.perf_counter() - started
            command = shlex.join(["slidax", *sys.argv[1:]])
            write_certificate_report(parts, found, out, seconds=seconds, command=command)
        if json:
            print_json(found.as_json())
        else:
            print_certificates(found)
            if out is not None:
                say_where(out)
        if not found.holds:
            raise typer.Exit(NOT_CERTIFIED)
