"""`slidax run`."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import AsJson, Changes, Engine, Named
from .session import OUTCOME, errors_as_lines, parsed, prepare, print_json, say_warning, say_where

if TYPE_CHECKING:
    from slidax.scenarios import Scenario
    from slidax.simulation import Run

SECONDS = 20.0
"""For remedies to be tried after a run that left its envelope."""

STARTED = time.perf_counter()


def run(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="A folder for a report, log and figures; or FILE.mcap.")] = None,
    engine: Annotated[Engine | None, typer.Option(help="The engine; the scenario's own if not given.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Play the run in the browser, in three dimensions.")] = False,
    recording: Annotated[
        Path | None, typer.Option("--record", metavar="FILE", help="Write a replay: .html, .mp4 or .gif.")
    ] = None,
) -> None:
    """One closed-loop run: its metrics as a table, as JSON, or as a report.

    `--set scheme.name=NAME` puts another scheme in place of the scenario's own; `slidax list schemes`
    shows them. Of the file's scheme `performance`, `overshoot`, `bound` and `sampled_data` are kept, as far as NAME has
    them; all else takes NAME's own defaults, which are the paper's where it prints any. Other `--set scheme.…` apply
    after that.

    What is likely to go wrong is said before the run, and after one that left its envelope the likeliest reason with a
    remedy; `slidax explain` has the others.

    Exit code 0: the run reached its end inside its envelope; 2: the scenario is invalid; 3: it left its envelope, also
    if it came back, or became infinite.
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
            # What cannot be written is said before the run, not after it.
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
            command = shlex.join(["slidax", *sys.argv[1:]])
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
            _say_why(parts)
        if recording is not None or view:
            _look(parts, finished, view, recording)
        if not finished.outcome.ok:
            raise typer.Exit(OUTCOME)


def _require_log(parts: Scenario, log: Path) -> None:
    """What cannot be logged is said before the run, not after it."""
    from slidax.deploy.robot_loop import require_samples
    from slidax.logs import require_writer

    require_samples(parts)
    require_writer()
    log.parent.mkdir(parents=True, exist_ok=True)


def _write_log(parts: Scenario, finished: Run, log: Path) -> None:
    """The run once more, the law called sample by sample as a robot calls it, to the sample at which it ended."""
    from slidax.deploy.robot_loop import lockstep, write_stepped

    write_stepped(parts, lockstep(parts, int(finished.tally.samples)), log)


def _warn_beforehand(parts: Scenario) -> None:
    """What is likely to go wrong, one line each."""
    from slidax.diagnosis import beforehand

    for said in beforehand(parts):
        say_warning(said)


def _warn_of_rejections(finished: Run) -> None:
    """Print how many measurements the law's gate rejected, if there are any."""
    from slidax._errors import counted

    rejected = finished.tally.rejected
    if rejected is None or not int(rejected):
        return
    say_warning(
        f"the law's gate rejected {int(rejected)} of {counted(int(finished.tally.samples), 'measurement')} as "
        "implausible for this arm, and the last torque stood; the signal `rejected` of a log (`--out FOLDER`) has "
        "their times; if the measurements are right, raise a limit of `scheme.sampled_data.gate`"
    )


def _say_why(parts: Scenario) -> None:
    """The likeliest cause; all of them are what `slidax explain` is for."""
    from slidax.diagnosis import first_line

    why = first_line(parts, seconds=SECONDS)
    if why:
        typer.echo(f"Most likely: {why}", err=True)


def _require_views(view: bool, recording: Path | None) -> None:
    """Before a long run, not after it."""
    from slidax import views

    if view:
        views.require_show()
    if recording is not None:
        views.require_record(recording)


def _look(parts: Scenario, finished: Run, view: bool, recording: Path | None) -> None:
    from slidax import views

    title = parts.description.title
    if recording is not None:
        made = views.record(finished, parts.plant, recording, title=title)
        typer.echo(f"The replay is in {made.resolve()}", err=True)
    if view:
        shown = views.show(finished, parts.plant, title=title)
        typer.echo(f"The replay is at {shown.url} until Ctrl-C", err=True)
        shown.wait()
