"""Commands about runs: `run`, `explain`, `compare`, `loop`, `replay`."""

from __future__ import annotations

import math
import os
import time
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .common import (
    OUTCOME,
    AsJson,
    Changes,
    Engine,
    Named,
    command_line,
    errors_as_lines,
    parse_changes,
    prepare,
    print_json,
    say,
    say_warning,
    say_where,
    stage_bar,
)

if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario
    from slidax.simulation.outcome import Outcome
    from slidax.simulation.run import Run

SECONDS = 20.0
"""Time limit for testing remedies after a run that left its envelope [s]."""

STARTED = time.perf_counter()


def run(
    scenario: Named,
    changes: Changes = None,
    json: AsJson = False,
    long: Annotated[bool, typer.Option("--long", help="Print every metric.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for a report, log and figures; or FILE.mcap for a log.")
    ] = None,
    engine: Annotated[Engine | None, typer.Option(help="Simulation engine; default: the scenario's.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Replay the run in the browser, in three dimensions.")] = False,
    recording: Annotated[
        Path | None, typer.Option("--record", metavar="FILE.html", help="Write a replay in three dimensions as a page.")
    ] = None,
) -> None:
    """Simulate a closed loop, and report its metrics as a table, as JSON, or as a page.

    `--set scheme.name=NAME` replaces the scenario's scheme; `slidax list schemes` lists all names. The new scheme keeps
    the file's `performance`, `overshoot`, `bound` and `sampled_data`, as far as it has these parameters. Its other
    parameters take their defaults: the values in the paper, if there are any. Each other `--set` applies after that.

    Likely problems are printed before the run. After a run that left its envelope, the likeliest cause is printed with
    a remedy; `slidax explain` prints the others.

    Exit code 0: the run ended inside its envelope; 2: the scenario is invalid; 3: the run left its envelope, even if
    it came back, or became infinite.
    """
    with errors_as_lines():
        prepare()
        from slidax.scenarios.load import load

        from .tables import print_run, run_as_json

        chosen = {} if engine is None else {"simulation.engine": engine.value}
        parts = load(scenario, parse_changes(changes or []) | chosen)
        log, folder = (out, None) if out is not None and out.suffix == ".mcap" else (None, out)
        if log is not None:
            _require_log(parts, log)
        if folder is not None:
            from slidax.analysis.index_sums import INDEX_SUMS
            from slidax.report import files
            from slidax.report.files import write_scenario
            from slidax.report.pages import write_run_report
            from slidax.simulation.parquet import require_pyarrow

            require_pyarrow("writing the log")
            # Fails before the run if the folder cannot be written.
            folder.mkdir(parents=True, exist_ok=True)
        if view or recording is not None:
            _require_views(view, recording)
        _warn_beforehand(parts)
        import_s = time.perf_counter() - STARTED
        whole = folder is not None or view or recording is not None
        finished = parts.simulate(log_every=0 if whole else _sparse(parts))
        summary = run_as_json(parts, finished, import_s)
        if folder is not None:
            files.write_log(finished, folder / "log.parquet")
            write_scenario(parts.description, folder / "scenario.yaml")
            report = partial(write_run_report, parts, finished, folder, also=INDEX_SUMS, command=command_line())
            report()
        if log is not None:
            _write_log(parts, finished, log)
        if json:
            print_json(summary)
        else:
            print_run(parts, finished, summary, every=long)
            if folder is not None:
                say_where(folder)
            if log is not None:
                typer.echo(f"The log is in {log.resolve()}")
        _warn_of_rejections(finished)
        if not finished.outcome.ok:
            if json:
                say(finished.outcome.message, err=True)
            cause = _print_cause(parts, finished.outcome)
            if folder is not None and cause:
                report(cause=cause)
        if recording is not None or view:
            _replay(parts, finished, view, recording)
        if not finished.outcome.ok:
            raise typer.Exit(OUTCOME)


ROWS = 20_000
"""Largest number of samples that a run without `--out` logs, for its verdict."""


def _sparse(parts: Scenario) -> int:
    """Return the log interval of a run without `--out` [samples]."""
    from slidax.simulation.define import MOST_SAMPLES

    # Runs with more samples are refused.
    samples = min(parts.t1 / parts.period, MOST_SAMPLES)
    return max(parts.log_every or 1, math.ceil(samples / ROWS))


def _require_log(parts: Scenario, log: Path) -> None:
    """Raise a DefinitionError before the run if it cannot be logged as an MCAP file."""
    from slidax.export.loop_plans import arm_to_move, require_samples
    from slidax.runtime.logs.mcap_files import require_writer

    require_samples(parts)
    arm_to_move(parts)
    require_writer()
    log.parent.mkdir(parents=True, exist_ok=True)


def _write_log(parts: Scenario, finished: Run, log: Path) -> None:
    """Repeat the run up to its end, calling the law sample by sample as a robot does, and write its log."""
    from slidax.export.lockstep import lockstep, write_lockstep_log

    write_lockstep_log(parts, lockstep(parts, int(finished.tally.samples)), log)


def _warn_beforehand(parts: Scenario) -> None:
    """Print likely problems of a run before it starts, one line each."""
    from slidax.analysis.forecast import forecast

    for problem in forecast(parts):
        say_warning(problem)


def _warn_of_rejections(finished: Run) -> None:
    """Print the number of measurements that the law's gate rejected, if any."""
    from slidax.core.errors import count_noun

    rejected = finished.tally.rejected
    if rejected is None or not int(rejected):
        return
    say_warning(
        f"the law's gate rejected {int(rejected)} of {count_noun(int(finished.tally.samples), 'measurement')} as "
        "implausible for this arm and kept the last torque; the signal `rejected` of a log (`--out FOLDER`) has "
        "their times; if the measurements are correct, raise a limit of `scheme.sampled_data.gate`"
    )


def _print_cause(parts: Scenario, outcome: Outcome) -> str:
    """Print and return the likeliest cause; without one, a general remedy, unless the outcome has a remedy."""
    from slidax.analysis.explain import likeliest_cause

    cause = likeliest_cause(parts, seconds=SECONDS)
    # Only the outcome of a run that continued outside its envelope lacks a remedy.
    general = "" if outcome.beyond is None else "Allow more torque, or shorten the period."
    line = f"Most likely: {cause}" if cause else general
    if line:
        say(line, err=True)
    return line


def _require_views(view: bool, recording: Path | None) -> None:
    """Raise a DefinitionError before the run if a package for replays is missing."""
    from slidax.report import replay as views

    if view:
        views.require_show()
    if recording is not None:
        views.require_record(recording)


def _replay(parts: Scenario, finished: Run, view: bool, recording: Path | None) -> None:
    from slidax.report import replay as views

    title = parts.description.title
    if recording is not None:
        path = views.record(finished, parts.plant, recording, title=title)
        typer.echo(f"The replay is in {path.resolve()}", err=True)
    if view:
        replay = views.show(finished, parts.plant, title=title)
        typer.echo(f"The replay is at {replay.url} until Ctrl-C", err=True)
        replay.wait()


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
        from slidax.analysis.explain import explain, read_saved
        from slidax.analysis.run_record import RunRecord, require_explainable

        scenario, columns, full = read_saved(run)
        require_explainable(scenario)
        record = (
            RunRecord.of_columns(scenario, columns) if full else RunRecord.of(scenario, scenario.simulate(log_every=1))
        )
        answers = explain(scenario, record, tries=tries)
        if json:
            print_json({"causes": [answer.as_json() for answer in answers]})
            return
        if not answers:
            reason = "the run stayed inside its envelope" if record.kept else "the log shows none of the known causes"
            typer.echo(f"Nothing to explain: {reason}.")
        for number, answer in enumerate(answers, 1):
            say(f"{number}. {answer.sentence()}", hang=len(f"{number}. "))


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario


def compare(
    scenario: Named,
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="Schemes to compare; default: all.")] = "",
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Set a field of all schemes; repeatable."),
    ] = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Folder for a report with figures and results.json.")] = None,
) -> None:
    """Compare several schemes on the same task, metric by metric; the best value is bold.

    Each scheme replaces the scenario's own as with `slidax run --set scheme.name=NAME`; then each `--set` applies to
    all. For a scheme without an envelope, samples outside the scenario's envelope are counted.

    Exit code 0: at least one run reached its end inside its envelope; 2: the request is invalid; 3: none did.
    """
    with errors_as_lines():
        prepare()
        from slidax.analysis.index_sums import INDEX_SUMS
        from slidax.report.comparison import Rival, results, write_comparison

        from .tables import print_comparison

        values = parse_changes(changes or [])
        parts = _switched(scenario, schemes, values)
        judge = _judge(scenario, values)
        rivals = {}
        with stage_bar() as begin:
            for name, each in parts.items():
                begin(name, len(parts))
                rivals[name] = Rival.simulated(each, judge, logged=out is not None)
        if out is not None:
            write_comparison(rivals, out, also=INDEX_SUMS, command=command_line())
        if json:
            print_json(results(rivals, INDEX_SUMS))
        else:
            print_comparison(rivals)
            if out is not None:
                say_where(out)
        if not any(rival.run.outcome.ok for rival in rivals.values()):
            typer.echo("none of the runs reached its end inside its envelope", err=True)
            raise typer.Exit(OUTCOME)


def _switched(scenario: str, schemes: str, changes: dict[str, Any]) -> dict[str, Scenario]:
    """Return the scenario with each scheme, by the scheme's name."""
    from slidax.core.errors import DefinitionError
    from slidax.scenarios.catalogue import catalogue
    from slidax.scenarios.load import load
    from slidax.scenarios.schemes import PRESETS

    if "scheme.name" in changes:
        raise DefinitionError("`--set scheme.name` does not work here: name the schemes with `--schemes`")
    every = [name for name, preset in PRESETS.items() if preset.complete]
    names = [name.strip() for name in schemes.split(",") if name.strip()] if schemes else every
    if not names:
        raise DefinitionError("`--schemes` is empty: give some, such as `--schemes cftsmppc,ftsmc`")
    scenarios = {}
    for name in dict.fromkeys(names):
        try:
            scenarios[name] = load(scenario, {"scheme.name": name, **changes})
        except DefinitionError as error:
            if name not in catalogue()["schemes"] or not changes:
                raise
            raise DefinitionError(f"with the scheme `{name}`: {error}") from None
    return scenarios


def _judge(scenario: str, changes: dict[str, Any]) -> Scenario:
    """Return the scenario with its own scheme; its envelope is used for schemes without an envelope."""
    from slidax.core.errors import DefinitionError
    from slidax.scenarios.load import load

    try:
        return load(scenario, changes)
    except DefinitionError:
        # A change may set a field that only the other schemes have.
        return load(scenario)


if TYPE_CHECKING:
    from slidax.scenarios.scenario import Scenario

Simulator = StrEnum("Simulator", ["auto", "mujoco", "own"])
"""Simulator of the arm."""

PORT = 8765
"""Foxglove's default port."""


def loop(
    scenario: Named,
    changes: Changes = None,
    seconds: Annotated[float | None, typer.Option("--time", help="Duration [s]; default: the scenario's.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Write a log.")] = None,
    arm: Annotated[Simulator, typer.Option(help="Arm simulator; `auto`: MuJoCo, if possible.")] = Simulator.auto,
    hog: Annotated[bool, typer.Option("--cpu-hog", help="Keep all CPU cores busy during the run.")] = False,
    patience: Annotated[int, typer.Option(help="Number of ticks without a command until the arm brakes.", min=1)] = 20,
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve live data to Foxglove on this machine.")] = False,
    port: Annotated[int, typer.Option(help="Port of the Foxglove server.", min=1, max=65535)] = PORT,
    histogram: Annotated[
        Path | None, typer.Option(metavar="FILE.svg", help="Write a histogram of the latencies.")
    ] = None,
    json: AsJson = False,
) -> None:
    """Run the exported law and a simulated arm in real time: two processes on the same clock, and a third for the log.

    The arm does not wait for the law. It ignores a delayed command and keeps the last torque. The next measurement
    tells the law so. After several periods (ticks) without a command the arm brakes. The law stops if measurements are
    missing for as long.

    Real-time priority and locked memory are requested from the system; a warning names those that it refuses.

    Exit code 0: the run ended inside its envelope, even if ticks were missed; 2: the scenario is invalid; 3: the run
    left its envelope, or a process stopped.
    """
    with errors_as_lines():
        prepare()
        from slidax.export.real_time_loop import run_loop
        from slidax.scenarios.load import load

        from .tables import print_loop

        values = parse_changes(changes or [])
        if seconds is not None:
            values["simulation.t1"] = seconds
        parts = _with_simulator(load(scenario, values), arm)
        if foxglove:
            typer.echo(f"Live data: Foxglove, open connection, ws://127.0.0.1:{port}", err=True)
        result = run_loop(
            parts, log=out, port=port if foxglove else None, patience=patience, hogs=(os.cpu_count() or 1) if hog else 0
        )
        if histogram is not None:
            from slidax.report.figures.loops import latencies
            from slidax.report.figures.style import save

            save(latencies(result.times, result.period), histogram)
        for refusal in result.not_granted():
            say_warning(refusal)
        if json:
            print_json({"scenario": parts.name, "arm": parts.description.simulation.plant, **result.as_json()})
        else:
            print_loop(parts, result)
            if out is not None:
                typer.echo(f"The log is in {out.resolve()}")
        if not result.good:
            raise typer.Exit(OUTCOME)


def _with_simulator(parts: Scenario, by: Any) -> Scenario:
    """Return the scenario with another simulator of the arm.

    - `by`: "own", "mujoco", or "auto" for MuJoCo if possible.
    """
    from importlib.util import find_spec

    from slidax.arms.articulated import Articulated
    from slidax.core.errors import DefinitionError
    from slidax.scenarios.load import alter

    if by == Simulator.own:
        return alter(parts, {"simulation.plant": "own"})
    possible = isinstance(parts.plant.robot, Articulated) and find_spec("mujoco") is not None
    if by == Simulator.mujoco and not possible:
        raise DefinitionError(
            "MuJoCo needs an articulated arm and its package (pip install 'slidax[robots]'): use `--arm own`"
        )
    load = parts.plant.load
    steady = load is None or (float(load.attached) <= 0 and float(load.released) >= parts.t1)
    return alter(parts, {"simulation.plant": "mujoco"}) if possible and (steady or by == Simulator.mujoco) else parts


def replay(
    log: Annotated[Path, typer.Argument(help="MCAP file from `slidax run` or `slidax loop`.")],
    json: AsJson = False,
) -> None:
    """Replay a log through its law: the same measurements must give the same torques, bit for bit.

    The log contains the scenario.

    Exit code 0: all torques are identical; 2: the file is not such a log; 3: the torques differ; the first is printed.
    """
    with errors_as_lines():
        prepare()
        from slidax.export.lockstep import replay as replayed
        from slidax.runtime.logs.mcap_files import read_mcap

        content = read_mcap(log)
        if not content.complete:
            say_warning(f"`{log}` is incomplete because its writer was stopped; the complete part is read")
        comparison = replayed(content)
        if json:
            print_json({**comparison.as_json(), "whole": content.complete})
        else:
            say(comparison.sentence())
        if comparison.first is not None:
            raise typer.Exit(OUTCOME)
