"""`slidax certify`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson, Changes, Named
from .session import command_line, errors_as_lines, parsed, prepare, print_json, say_where

NOT_CERTIFIED = 4
"""Exit code if a certificate does not hold."""


def certify(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
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
        from slidax.certificates import certify as certified
        from slidax.scenarios import load
        from slidax.terminal import print_certificates

        started = time.perf_counter()
        parts = load(scenario, parsed(changes or []))
        certificates = certified(parts, runs=runs, seed=seed)
        if out is not None:
            from slidax.reports import write_certificate_report

            seconds = time.perf_counter() - started
            write_certificate_report(parts, certificates, out, seconds=seconds, command=command_line())
        if json:
            print_json(certificates.as_json())
        else:
            print_certificates(certificates)
            if out is not None:
                say_where(out)
        if not certificates.holds:
            raise typer.Exit(NOT_CERTIFIED)
