"""`slidax league`."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import errors_as_lines, prepare, print_json, say_where

OUT = Path("league")


def league(
    out: Annotated[Path, typer.Option(help="Folder of the matches, the page, league.md and results.json.")] = OUT,
    tasks: Annotated[str, typer.Option(metavar="A,B,C", help="The tasks; all if not given.")] = "",
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="The schemes; all if not given.")] = "",
    scheme: Annotated[
        list[str] | None,
        typer.Option(metavar="MODULE:NAME", help="One more, by the name of its class or preset; repeatable."),
    ] = None,
    form: Annotated[str, typer.Option(help="`sampled-data`, `printed` or `both`.")] = "both",
    budget: Annotated[int | None, typer.Option(help="How many sets of gains the tuner tries.", min=1)] = None,
    processes: Annotated[int | None, typer.Option(help="How many at once; all cores if not given.", min=1)] = None,
    small: Annotated[bool, typer.Option("--small", help="A trial: few cases, short runs, hardly any tuning.")] = False,
    json: AsJson = False,
) -> None:
    """All schemes on common tasks: tuned alike on some cases, judged by others, all by the same tolerance band.

    Each match is kept in the folder as soon as it is played; the same command goes on where it was interrupted.

    Exit code 0: whatever was found; 2: the request is invalid; 130: it was interrupted.
    """
    with errors_as_lines():
        prepare()
        sys.path.insert(0, "")
        from slidax.league import Season, entries, forms_of, names, task
        from slidax.league.markdown import verdicts
        from slidax.league.page import as_json, write_league
        from slidax.league.season import BUDGET
        from slidax.league.standing import standing
        from slidax.league.summary import overall

        listed = _words(schemes) if schemes else None
        asked = entries(listed, scheme or [], forms_of(form))
        season = Season({name: task(name) for name in _words(tasks) or names()}, asked, budget or BUDGET)
        season = season.small() if small else season
        started = time.perf_counter()
        total, done = len(season.tasks) * len(season.entries), 0

        def seen(name: str, entry: object, seconds: float) -> None:
            nonlocal done
            done += 1
            if sys.stderr.isatty():
                passed = time.perf_counter() - started
                typer.echo(f"{done} of {total} after {passed:.0f} s: {name}, {entry}, {seconds:.0f} s", err=True)

        try:
            results = season.played(out, processes, seen)
        except KeyboardInterrupt:
            typer.echo("Interrupted; the same command goes on", err=True)
            raise typer.Exit(130) from None
        command = shlex.join(["slidax", *sys.argv[1:]])
        write_league(results, out, seconds=time.perf_counter() - started, command=command)
        tables = [standing(name, results.on(name)) for name in season.tasks]
        whole = overall(tables, season.entries)
        if json:
            print_json(as_json(results, tables, whole))
            return
        for table, line in zip(tables, verdicts(tables), strict=True):
            typer.echo(f"{table.task}: {line.replace('**', '')}")
        say_where(out)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
