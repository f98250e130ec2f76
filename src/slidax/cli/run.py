"""`slidax run`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import AsJson, Changes, Engine, Named
from .session import OUTCOME, command_line, errors_as_lines, parsed, prepare, print_json, say_warning, say_where

if TYPE_CHECKING:
    from slidax.scenarios import Scenario
    from slidax.simulation import Run

SECONDS = 20.0
"""Time for testing remedies after a run that left its envelope [s]."""

STARTED = time.perf_counter()


def run(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Folder for a report, log and figures; or FILE.mcap.")] = None,
    engine: Annotated[Engine | None, typer.Option(help="Engine; default: the scenario's.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Replay the run in the browser, in three dimensions.")] = False,
    recording: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Write a replay to FILE.html.")
    ] = None,
) -> None:
    """Simulate a closed loop, and report its metrics as a table, as JSON, or as a page.

    `--set scheme.name=NAME` replaces the scenario's scheme; `slidax list schemes` lists them. The new scheme takes over
    `performance`, `overshoot`, `bound` and `sampled_data` of the file as far as it has them; its other parameters take
    their defaults, from the paper if it prints any. Other `--set scheme.…` apply after that.

    Likely problems are printed before the run. After a run that left its envelope, the likeliest cause is printed with
    a remedy; `slidax explain` prints the others.

    Exit code 0: the run ended inside its envelope; 2: the scenario is invalid; 3: the run left its envelope, even if
    it came back, or became infinite.
    """
    with errors_as_lines():
        prepare()
        from slidax.scenarios import load
        from slidax.terminal import print_run, run_as_json

        chosen = {} if engine is None else {"simulation.engine": engine.value}
        parts = load(scenario, parsed(changes or []) | chosen)
        log, folder = (out, None) if out is not None and out.suffix == ".mcap" else (None, out)
        if log is not None:
            _require_log(parts, log)
        if folder is not None:
            from slidax.papers.indices import INDICES
            from slidax.reports import parquet, write_run_report, write_scenario
            from slidax.simulation import require_pyarrow

            require_pyarrow("writing the log")
            # Fails before the run if the folder cannot be written.
            folder.mkdir(parents=True, exist_ok=True)
        if view or recording is not None:
            _require_views(view, recording)
        _warn_beforehand(parts)
        import_s = time.perf_counter() - STARTED
        finished = parts.simulate(log_every=0 if folder is not None or view or recording is not None else None)
        summary = run_as_json(parts, finished, import_s)
        if folder is not None:
            parquet.write_log(finished, folder / "log.parquet")
            write_scenario(parts.description, folder / "scenario.yaml")
            command = command_line()
            write_run_report(parts, finished, folder, also=INDICES, command=command)
        if log is not None:
            _write_log(parts, finished, log)
        if json:
            print_json(summary)
        else:
            print_run(parts, finished, summary)
            if folder is not None:
                say_where(folder)
            if log is not None:
                typer.echo(f"The log is in {log.resolve()}")
        _warn_of_rejections(finished)
        if not finished.outcome.ok:
            typer.echo(finished.outcome.message, err=True)
            _print_cause(parts)
        if recording is not None or view:
            _replay(parts, finished, view, recording)
        if not finished.outcome.ok:
            raise typer.Exit(OUTCOME)


def _require_log(parts: Scenario, log: Path) -> None:
    """Fail before the run if it cannot be logged."""
    from slidax.deploy.robot_loop import require_samples
    from slidax.logs import require_writer

    require_samples(parts)
    require_writer()
    log.parent.mkdir(parents=True, exist_ok=True)


def _write_log(parts: Scenario, finished: Run, log: Path) -> None:
    """Repeat the run with the law called sample by sample, as a robot calls it, until it ended."""
    from slidax.deploy.robot_loop import lockstep, write_stepped

    write_stepped(parts, lockstep(parts, int(finished.tally.samples)), log)


def _warn_beforehand(parts: Scenario) -> None:
    """Print likely problems, one line each."""
    from slidax.diagnosis import beforehand

    for problem in beforehand(parts):
        say_warning(problem)


def _warn_of_rejections(finished: Run) -> None:
    """Print the number of measurements that the law's gate rejected, if any."""
    from slidax._errors import counted

    rejected = finished.tally.rejected
    if rejected is None or not int(rejected):
        return
    say_warning(
        f"the law's gate rejected {int(rejected)} of {counted(int(finished.tally.samples), 'measurement')} as "
        "implausible for this arm and kept the last torque; the signal `rejected` of a log (`--out FOLDER`) has "
        "their times; if the measurements are correct, raise a limit of `scheme.sampled_data.gate`"
    )


def _print_cause(parts: Scenario) -> None:
    """Print the likeliest cause."""
    from slidax.diagnosis import first_line

    cause = first_line(parts, seconds=SECONDS)
    if cause:
        typer.echo(f"Most likely: {cause}", err=True)


def _require_views(view: bool, recording: Path | None) -> None:
    """Fail before the run if a package is missing."""
    from slidax import views

    if view:
        views.require_show()
    if recording is not None:
        views.require_record(recording)


def _replay(parts: Scenario, finished: Run, view: bool, recording: Path | None) -> None:
    from slidax import views

    title = parts.description.title
    if recording is not None:
        path = views.record(finished, parts.plant, recording, title=title)
        typer.echo(f"The replay is in {path.resolve()}", err=True)
    if view:
        replay = views.show(finished, parts.plant, title=title)
        typer.echo(f"The replay is at {replay.url} until Ctrl-C", err=True)
        replay.wait()
