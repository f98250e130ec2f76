"""`slidax benchmark`."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from .options import AsJson
from .session import command_line, errors_as_lines, prepare, print_json, say_where

OUT = Path("benchmark")


def benchmark(
    out: Annotated[Path, typer.Option(help="Folder of the results, the page, benchmark.md and results.json.")] = OUT,
    tasks: Annotated[str, typer.Option(metavar="A,B,C", help="The tasks; by default all.")] = "",
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="The schemes; by default all.")] = "",
    scheme: Annotated[
        list[str] | None,
        typer.Option(metavar="MODULE:NAME", help="A further scheme, by the name of its class or preset; repeatable."),
    ] = None,
    form: Annotated[str, typer.Option(help="`sampled-data`, `printed` or `both`.")] = "both",
    budget: Annotated[int | None, typer.Option(help="Number of gain sets that the tuner tries.", min=1)] = None,
    processes: Annotated[int | None, typer.Option(help="Parallel processes; by default one per core.", min=1)] = None,
    small: Annotated[bool, typer.Option("--small", help="A trial: few cases, short runs, hardly any tuning.")] = False,
    json: AsJson = False,
) -> None:
    """Benchmark all schemes on common tasks: tuned alike on some cases, judged on others by the same tolerance band.

    The folder keeps each result as soon as it is there; the same command resumes an interrupted benchmark.

    Exit code 0: done; 2: the request is invalid; 130: interrupted.
    """
    with errors_as_lines():
        prepare()
        sys.path.insert(0, "")
        from slidax.league import BenchmarkRound, entries, forms_of, names, ranking, task
        from slidax.league.markdown import verdicts
        from slidax.league.page import as_json, write_benchmark
        from slidax.league.season import BUDGET
        from slidax.league.summary import overall

        listed = _words(schemes) if schemes else None
        schemes_in_forms = entries(listed, scheme or [], forms_of(form))
        tasks_by_name = {name: task(name) for name in _words(tasks) or names()}
        round_ = BenchmarkRound(tasks_by_name, schemes_in_forms, budget or BUDGET)
        round_ = round_.small() if small else round_
        started = time.perf_counter()
        total, done = len(round_.tasks) * len(round_.entries), 0

        def on_result(name: str, entry: object, seconds: float) -> None:
            nonlocal done
            done += 1
            if sys.stderr.isatty():
                passed = time.perf_counter() - started
                typer.echo(f"{done} of {total} after {passed:.0f} s: {name}, {entry}, {seconds:.0f} s", err=True)

        try:
            results = round_.run(out, processes, on_result)
        except KeyboardInterrupt:
            typer.echo("Interrupted; the same command resumes", err=True)
            raise typer.Exit(130) from None
        command = command_line()
        write_benchmark(results, out, seconds=time.perf_counter() - started, command=command)
        tables = [ranking(name, results.on(name)) for name in round_.tasks]
        if json:
            print_json(as_json(results, tables, overall(tables, round_.entries)))
            return
        for table, line in zip(tables, verdicts(tables), strict=True):
            typer.echo(f"{table.task}: {line.replace('**', '')}")
        say_where(out)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
