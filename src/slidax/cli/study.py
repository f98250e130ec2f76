"""`slidax study`."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from slidax._writing import NO_ROOM

from .options import AsJson, Engine
from .session import errors_as_lines, prepare, print_json, say_where

if TYPE_CHECKING:
    from slidax.studies import AbstractResult, AbstractStudy, How, PartDone

INTERRUPTED = 130
"""Exit code after Ctrl-C, as a shell has it."""


def study(
    file: Annotated[Path, typer.Argument(help="The study, a YAML file.")],
    out: Annotated[Path | None, typer.Option(help="Write rows, results and a report there.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the rows that are in that folder.")] = False,
    cluster: Annotated[
        str | None, typer.Option(help="Where rows are computed: `local:2`, or the address of a Dask scheduler.")
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            metavar="I/N", help="Compute part I of N, such as 2/4; other processes compute the others into one --out."
        ),
    ] = None,
    runs: Annotated[int | None, typer.Option(help="Number of runs; the study's own if not given.", min=1)] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; the study's own if not given.", min=0)] = None,
    engine: Annotated[Engine | None, typer.Option(help="The engine; the study's own if not given.")] = None,
    case: Annotated[
        int | None,
        typer.Option(metavar="ROW", help="Write a row of --out as a scenario, case-ROW.yaml there; run nothing."),
    ] = None,
    progress: Annotated[
        bool, typer.Option("--progress", help="Say how many rows are done, a line each second, for programs.")
    ] = False,
    json: AsJson = False,
) -> None:
    """Many runs: probabilities, maps, the worst case, sensitivities, tuning, comparisons.

    With `--out` each row is kept as soon as it is computed. Ctrl-C ends a study, and `--resume` goes on where it was,
    on this machine or another one. Several processes may write one folder; `--part` shares the rows between them.

    Exit code 0: whatever was found; 2: the study is invalid; 130: it was interrupted.
    """
    with errors_as_lines():
        prepare()
        from slidax.studies import How, Part, PartDone, read_study

        changes = {"runs": runs, "seed": seed, "engine": None if engine is None else engine.value}
        asked = read_study(file, {key: value for key, value in changes.items() if value is not None})
        if resume and out is None:
            from slidax._errors import DefinitionError

            raise DefinitionError("`--resume` needs the folder that it goes on with: --out DIR")
        if case is not None:
            _write_case(out, case)
            return
        started = time.perf_counter()
        with _told_what_is_kept(out), Lines() if progress else Bar() as bar, suppress(KeyboardInterrupt):
            share = None if part is None else Part.parsed(part)
            how = How(out, resume, begin=bar.begin, seen=bar.seen, made_by=_made_by(), part=share)
            try:
                found = _run(asked, how, cluster)
            except PartDone as done:
                bar.close()
                _tell_part(asked, done, part or "", json)
                return
            bar.close()
            _tell(asked, found, out, time.perf_counter() - started, json)
            return
        kept = f"; go on with: {shlex.join(_again())}" if out is not None else ", and nothing is kept without --out"
        typer.echo(f"Interrupted{kept}", err=True)
        raise typer.Exit(INTERRUPTED)


def _write_case(out: Path | None, row: int) -> None:
    from slidax._errors import DefinitionError
    from slidax.reports import write_scenario
    from slidax.studies import scenario_of_row

    if out is None:
        raise DefinitionError("`--case` needs the folder that the row is in: --out DIR")
    path = out / f"case-{row}.yaml"
    write_scenario(scenario_of_row(out, row), path)
    typer.echo(f"The scenario is in {path.resolve()}")


def _run(asked: AbstractStudy, how: How, cluster: str | None) -> AbstractResult:
    if cluster is None:
        return asked.run(how)
    from slidax.studies.cluster import Cluster

    with Cluster(cluster) as pool:
        how.pool = pool
        return asked.run(how)


def _tell(asked: AbstractStudy, found: AbstractResult, out: Path | None, seconds: float, json: bool) -> None:
    from slidax.terminal import print_study

    if out is not None:
        from slidax.reports import write_study_report

        write_study_report(asked, found, out, seconds=seconds, command=shlex.join(["slidax", *sys.argv[1:]]))
    answer = found.as_json()
    if out is not None and "worst" in answer and (out / "worst.yaml").exists():
        answer["worst"]["scenario"] = str(out / "worst.yaml")
    if json:
        print_json(answer)
        return
    print_study(found)
    if out is not None:
        say_where(out)


@contextmanager
def _told_what_is_kept(out: Path | None) -> Iterator[None]:
    """An error of the disk says which rows are kept, and how the study goes on."""
    try:
        yield
    except OSError as error:
        from slidax._errors import DefinitionError
        from slidax.studies.store import rows_kept

        if out is None or error.filename is None or not out.is_dir():
            raise
        kept = rows_kept(out)
        remedy = "free some space" if error.errno in NO_ROOM else "make it possible to write this file"
        raise DefinitionError(
            f"cannot write `{os.fsdecode(error.filename)}`: {error.strerror}. {kept} rows are kept in `{out}`: "
            f"{remedy}, and go on with: {shlex.join(_again())}"
        ) from None


def _tell_part(asked: AbstractStudy, done: PartDone, part: str, json: bool) -> None:
    if json:
        print_json({"kind": asked.study, "part": part, "runs": done.total, "missing": done.missing})
        return
    typer.echo(
        f"Part {part} is done. {done.missing} of the study's {done.total} rows are missing, which other parts compute. "
        f"When all are done, write table and report with: {shlex.join(_again(without='--part'))}"
    )


def _again(without: str | None = None) -> list[str]:
    """The command that goes on with a study, without an option and its value."""
    words, rest = ["slidax"], iter(sys.argv[1:])
    for word in rest:
        if word == without:
            next(rest, None)
        elif without is None or not word.startswith(f"{without}="):
            words.append(word)
    return words if "--resume" in words else [*words, "--resume"]


def _made_by() -> dict[str, str]:
    from slidax.reports import machine, versions

    return {**versions(), **machine()}


class Lines:
    """Rows that are done, as lines for a program."""

    def __init__(self) -> None:
        self._all = self._rows = 0
        self._said = 0.0

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, rows: int) -> None:
        """Rows there will be.

        - `rows`: how many at most.
        """
        self._all = rows
        self._say()

    def seen(self, rows: int) -> None:
        """Rows are done.

        - `rows`: how many are new.
        """
        self._rows += rows
        if time.perf_counter() - self._said >= 1.0 or self._rows >= self._all:
            self._say()

    def close(self) -> None:
        """Nothing is left to be said."""

    def _say(self) -> None:
        self._said = time.perf_counter()
        typer.echo(f"... {self._rows} of {self._all} rows", err=True)


class Bar:
    """Rows that are done, how fast, and the time that is left; on a terminal alone."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
        )
        self._bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
        self._task = self._bar.add_task("compiling", total=None, rate="")
        self._started = 0.0
        self._rows = 0

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def begin(self, rows: int) -> None:
        """Rows there will be.

        - `rows`: how many at most.
        """
        self._bar.update(self._task, total=rows)
        self._started = time.perf_counter()

    def seen(self, rows: int) -> None:
        """Rows are done.

        - `rows`: how many are new.
        """
        self._rows += rows
        rate = self._rows / max(time.perf_counter() - self._started, 1e-6)
        self._bar.update(self._task, advance=rows, description="simulating", rate=f"{rate:.0f} runs/s")

    def close(self) -> None:
        """Takes it off the terminal."""
        self._bar.stop()
