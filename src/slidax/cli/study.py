"""Commands about many runs: `study`, `benchmark`."""

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

from .common import INTERRUPTED, AsJson, Engine, command_line, errors_as_lines, prepare, print_json, say, say_where

if TYPE_CHECKING:
    from slidax.studies.runner import PartDone
    from slidax.studies.study import AbstractResult, AbstractStudy, RunOptions

GAPS = 5
"""Largest number of ranges of missing rows that `--resume` lists."""


def study(
    file: Annotated[Path, typer.Argument(help="The study, a YAML file.")],
    out: Annotated[Path | None, typer.Option(help="Folder for rows, results and a report.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Resume with the rows in the folder of --out.")] = False,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="Cluster that computes the rows: `local:2`, the address of a Dask scheduler, its scheduler file "
            "(scheduler.json), or `env` for DASK_SCHEDULER_ADDRESS."
        ),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Compute part I of N, such as 2/4; the other parts write to the same --out.",
        ),
    ] = None,
    runs: Annotated[int | None, typer.Option(help="Number of runs; default: the study's.", min=1)] = None,
    seed: Annotated[int | None, typer.Option(help="Random seed; default: the study's.", min=0)] = None,
    engine: Annotated[Engine | None, typer.Option(help="Simulation engine; default: the study's.")] = None,
    case: Annotated[
        int | None,
        typer.Option(metavar="ROW", help="Compute nothing, and write this row of --out as the scenario case-ROW.yaml."),
    ] = None,
    progress: Annotated[
        bool, typer.Option("--progress", help="Print the number of finished rows each second, for programs.")
    ] = False,
    json: AsJson = False,
) -> None:
    """Run a study of many runs: probabilities, maps, worst cases, sensitivities, tuning, comparisons.

    With `--out` each row is saved as soon as it is computed. Ctrl-C interrupts a study, and `--resume` continues it, on
    this machine or another one. Several processes can write to one folder; `--part` divides the rows among them.

    Exit code 0: finished; 2: the study is invalid; 130: interrupted.
    """
    with errors_as_lines():
        prepare()
        from slidax.studies.files import read_study
        from slidax.studies.runner import Part, PartDone
        from slidax.studies.study import RunOptions

        changes = {"runs": runs, "seed": seed, "engine": None if engine is None else engine.value}
        study_ = read_study(file, {key: value for key, value in changes.items() if value is not None})
        if resume and out is None:
            from slidax.core.errors import DefinitionError

            raise DefinitionError("`--resume` needs the folder to continue: --out DIR")
        if case is not None:
            _write_case(out, case)
            return
        started = time.perf_counter()
        with _with_saved_rows(out), Lines() if progress else Bar() as bar, suppress(KeyboardInterrupt):
            share = None if part is None else Part.parsed(part)

            def begin(rows: int) -> None:
                if out is not None and resume and study_.in_parts and share is None:
                    _say_missing(out, rows)
                bar.begin(rows)

            how = RunOptions(out, resume, begin=begin, progress=bar.advance, made_by=_made_by(), part=share)
            try:
                result = _run(study_, how, cluster)
            except PartDone as done:
                bar.close()
                _print_part(study_, done, part or "", json)
                return
            bar.close()
            _print(study_, result, out, time.perf_counter() - started, json)
            return
        kept = f"; resume with: {shlex.join(_again())}" if out is not None else "; nothing is saved without --out"
        typer.echo(f"Interrupted{kept}", err=True)
        raise typer.Exit(INTERRUPTED)


def _write_case(out: Path | None, row: int) -> None:
    from slidax.core.errors import DefinitionError
    from slidax.report.files import write_scenario
    from slidax.studies.files import scenario_of_row

    if out is None:
        raise DefinitionError("`--case` needs the folder with the row: --out DIR")
    path = out / f"case-{row}.yaml"
    write_scenario(scenario_of_row(out, row), path)
    typer.echo(f"The scenario is in {path.resolve()}")


def _run(study_: AbstractStudy, how: RunOptions, cluster: str | None) -> AbstractResult:
    if cluster is None:
        return study_.run(how)
    from slidax.studies.cluster import Cluster

    with Cluster(cluster) as pool:
        how.pool = pool
        return study_.run(how)


def _print(study_: AbstractStudy, result: AbstractResult, out: Path | None, seconds: float, json: bool) -> None:
    from .tables import print_study

    if out is not None:
        from slidax.report.pages import write_study_report

        write_study_report(study_, result, out, seconds=seconds, command=command_line())
    answer = result.as_json()
    if out is not None and "worst" in answer and (out / "worst.yaml").exists():
        answer["worst"]["scenario"] = str(out / "worst.yaml")
    if json:
        print_json(answer)
        return
    print_study(result)
    if out is not None:
        say_where(out)


@contextmanager
def _with_saved_rows(out: Path | None) -> Iterator[None]:
    """Report saved rows and the command that resumes the study, if a file cannot be written."""
    try:
        yield
    except OSError as error:
        from slidax.core.errors import DefinitionError
        from slidax.core.writing import NO_ROOM
        from slidax.studies.store import count_rows

        if out is None or error.filename is None or not out.is_dir():
            raise
        kept = count_rows(out)
        remedy = "free some space" if error.errno in NO_ROOM else "make this file writable"
        raise DefinitionError(
            f"cannot write `{os.fsdecode(error.filename)}`: {error.strerror}. {kept} rows are saved in `{out}`: "
            f"{remedy}, and resume with: {shlex.join(_again())}"
        ) from None


def _print_part(study_: AbstractStudy, done: PartDone, part: str, json: bool) -> None:
    if json:
        print_json({"kind": study_.study, "part": part, "runs": done.total, "missing": done.missing})
        return
    typer.echo(
        f"Part {part} is done. {done.missing} of {done.total} rows are left to the other parts. "
        f"After these, write table and report with: {shlex.join(_again(without='--part'))}"
    )


def _say_missing(out: Path, rows: int) -> None:
    from slidax.studies.store import PARTS, count_rows, missing_rows

    missing = rows - count_rows(out)
    if missing <= 0:
        return
    gaps = missing_rows(out, rows) if (out / PARTS).is_dir() else []
    where = ", ".join(f"{gap[0]} to {gap[-1]}" for gap in gaps[:GAPS]) + (", ..." if len(gaps) > GAPS else "")
    typer.echo(f"{missing} of {rows} rows are missing and are computed now{where and ': '}{where}", err=True)


def _again(without: str | None = None) -> list[str]:
    """Return the command that resumes a study; `without` is an option to omit with its value."""
    words, rest = ["slidax"], iter(sys.argv[1:])
    for word in rest:
        if word == without:
            next(rest, None)
        elif without is None or not word.startswith(f"{without}="):
            words.append(word)
    return words if "--resume" in words else [*words, "--resume"]


def _made_by() -> dict[str, str]:
    from slidax.report.page import machine, versions

    return {**versions(), **machine()}


class Lines:
    """Progress as lines on standard error, for programs that read them."""

    def __init__(self) -> None:
        self._total = self._rows = 0
        self._printed = 0.0

    def __enter__(self) -> Lines:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, rows: int) -> None:
        """Set the total number of `rows` of the study."""
        self._total = rows
        self._print()

    def advance(self, rows: int) -> None:
        """Add a number of finished `rows`."""
        self._rows += rows
        if time.perf_counter() - self._printed >= 1.0 or self._rows >= self._total:
            self._print()

    def close(self) -> None:
        """Do nothing."""

    def _print(self) -> None:
        self._printed = time.perf_counter()
        typer.echo(f"... {self._rows} of {self._total} rows", err=True)


class Bar:
    """Progress bar with rate and remaining time, on a terminal only."""

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
        """Set the total number of `rows` of the study."""
        self._bar.update(self._task, total=rows)
        self._started = time.perf_counter()

    def advance(self, rows: int) -> None:
        """Add a number of finished `rows`."""
        self._rows += rows
        rate = self._rows / max(time.perf_counter() - self._started, 1e-6)
        self._bar.update(self._task, advance=rows, description="simulating", rate=f"{rate:.0f} runs/s")

    def close(self) -> None:
        """Remove the bar from the terminal."""
        self._bar.stop()


OUT = Path("benchmark")


def benchmark(
    out: Annotated[Path, typer.Option(help="Folder of the results, the page, benchmark.md and results.json.")] = OUT,
    tasks: Annotated[str, typer.Option(metavar="A,B,C", help="The tasks; by default all.")] = "",
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="The schemes; by default all.")] = "",
    scheme: Annotated[
        list[str] | None,
        typer.Option(metavar="MODULE:NAME", help="A further scheme, by the name of its class or preset; repeatable."),
    ] = None,
    form: Annotated[
        str,
        typer.Option(help="`sampled-data` (made for the sample time), `printed` (as its source prints it) or `both`."),
    ] = "both",
    budget: Annotated[int | None, typer.Option(help="Number of gain sets that the tuner tries.", min=1)] = None,
    processes: Annotated[int | None, typer.Option(help="Parallel processes; by default one per core.", min=1)] = None,
    small: Annotated[
        bool, typer.Option("--small", help="Only try the command: few cases, short runs, hardly any tuning.")
    ] = False,
    json: AsJson = False,
) -> None:
    """Benchmark all schemes on common tasks: tuned alike on some cases, judged on others by the same tolerance band.

    Each result is saved in the folder as soon as it is computed; the same command resumes an interrupted benchmark.

    Exit code 0: done; 2: the request is invalid; 130: interrupted.
    """
    with errors_as_lines():
        prepare()
        sys.path.insert(0, "")
        from slidax.report.benchmark_page import as_json, name_with_form, summarise_tasks, write_benchmark
        from slidax.studies.benchmark.entries import entries, forms_of, names, task
        from slidax.studies.benchmark.ranking import rank_overall, ranking
        from slidax.studies.benchmark.rounds import BUDGET, BenchmarkRound

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
            raise typer.Exit(INTERRUPTED) from None
        command = command_line()
        write_benchmark(results, out, seconds=time.perf_counter() - started, command=command)
        tables = [ranking(name, results.on(name)) for name in round_.tasks]
        if json:
            print_json(as_json(results, tables, rank_overall(tables, round_.entries)))
            return
        for table, line in zip(tables, summarise_tasks(tables), strict=True):
            say(f"{table.task}: {line.replace('**', '')}", hang=2)
        for (name, refused), why in results.by_key.items():
            if isinstance(why, str):
                typer.echo(f"{name}: {name_with_form(refused)} cannot run: {why}", err=True)
        say_where(out)


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
