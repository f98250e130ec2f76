"""The command line. Everything heavy is imported inside the commands, so that `--help` answers at once."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from slidax.scenarios import Scenario
    from slidax.simulation import Run

STARTED = time.perf_counter()
DEFINITION, OUTCOME = 2, 3
"""Exit codes: something was asked for that cannot be; a run came to a bad end."""

app = typer.Typer(
    name="slidax",
    help="Sliding-mode control of robot arms, with an envelope drawn in advance.",
    epilog="Start with:  slidax run example-4.1",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


class Kind(StrEnum):
    """What `slidax list` can list."""

    schemes = "schemes"
    robots = "robots"
    trajectories = "trajectories"
    disturbances = "disturbances"
    performance = "performance"
    scenarios = "scenarios"


class Disturbance(StrEnum):
    """Which readings of the paper's disturbance `slidax reproduce` computes."""

    stated = "stated"
    off = "off"
    both = "both"


@app.command(epilog="Example:  slidax reproduce --out reproduction")
def reproduce(
    out: Annotated[Path, typer.Option(help="Where report.html, figures/ and results.json go.")] = Path("reproduction"),
    disturbance: Annotated[Disturbance, typer.Option(help="As stated, off, or both.")] = Disturbance.both,
) -> None:
    """The paper's figures and tables beside what is computed here, as one report."""
    with _errors_as_lines():
        _prepare()
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        from slidax.papers import cftsmppc

        console = Console(stderr=True)
        columns = (TextColumn("{task.description:<44}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("starting", total=1.0)
            cftsmppc.reproduce(
                out,
                disturbance=disturbance.value,
                progress=lambda stage, done: bar.update(task, description=stage, completed=done),
            )
        _say_where(out)


@app.command(epilog="Example:  slidax run example-4.1 --set disturbance.scale=0 --set scheme.surface.k1=0.4")
def run(
    scenario: Annotated[str, typer.Argument(help="A built-in scenario by name, or a YAML file.")],
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field, as YAML; repeatable.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write a report, a Parquet log and figures there.")] = None,
) -> None:
    """One closed-loop run: its metrics as a table, as JSON, or as a report.

    `--set scheme.name=NAME` puts another scheme in the place of the scenario's own; `slidax list schemes`
    shows them. Of the file's scheme `performance`, `overshoot` and `bound` are kept, as far as NAME has them; all else
    takes NAME's own defaults, which are the paper's where it prints any. Other `--set scheme.…` apply after that.

    Exit code 0: the run reached its end; 2: the scenario cannot be; 3: it left its envelope or became infinite.
    """
    with _errors_as_lines():
        _prepare()
        from slidax.scenarios import load

        parts = load(scenario, _parsed(changes or []))
        if out is not None:
            from slidax.reports import parquet, write_run_report

            parquet.require_pyarrow()
        import_s = time.perf_counter() - STARTED
        finished = parts.simulate(log_every=0 if out is not None else None)
        summary = _summary(parts, finished, import_s)
        if out is not None:
            parquet.write_log(finished, out / "log.parquet")
            write_run_report(parts, finished, out, command=shlex.join(["slidax", *sys.argv[1:]]))
        if json:
            _print_json(summary)
        else:
            _print_table(parts, finished, summary)
            if out is not None:
                _say_where(out)
        if not finished.outcome.ok:
            typer.echo(finished.outcome.message, err=True)
            raise typer.Exit(OUTCOME)


@app.command("list", epilog="Example:  slidax list scenarios")
def list_(
    kind: Annotated[Kind | None, typer.Argument(help="What to list; everything if not given.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """What there is, one line each."""
    with _errors_as_lines():
        _prepare()
        from slidax.scenarios import catalogue

        found = catalogue()
        shown = {kind.value: found[kind.value]} if kind else found
        if json:
            _print_json(shown)
            return
        width = max(len(name) for members in shown.values() for name in members)
        for title, members in shown.items():
            if not kind:
                typer.echo(typer.style(title, bold=True))
            for name, line in members.items():
                typer.echo(f"{'' if kind else '  '}{name:<{width}}  {line}")


@app.command(epilog="Example:  slidax schema > scenario.schema.json")
def schema() -> None:
    """The JSON schema of scenario files, for editors and other programs."""
    with _errors_as_lines():
        _prepare()
        from slidax import scenarios

        _print_json(scenarios.schema())


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        import slidax

        typer.echo(f"slidax {slidax.__version__}")
        raise typer.Exit


def main() -> None:
    """The entry point of the `slidax` command."""
    app()


def _prepare() -> None:
    """Switches 64-bit numbers and a compilation cache on, as the command line may: the process is its own."""
    import jax
    from platformdirs import user_cache_path

    jax.config.update("jax_enable_x64", True)
    if jax.config.jax_compilation_cache_dir is None:
        # Compiling takes most of the time of a short run; the second run of a scenario then need not.
        jax.config.update("jax_compilation_cache_dir", str(user_cache_path("slidax") / f"xla-{jax.__version__}"))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


@contextmanager
def _errors_as_lines() -> Iterator[None]:
    """A DefinitionError becomes one line and exit code 2; a traceback would hide it."""
    from slidax._errors import DefinitionError

    try:
        yield
    except DefinitionError as error:
        typer.echo(f"slidax: {error}", err=True)
        raise typer.Exit(DEFINITION) from None
    except BrokenPipeError:
        # The reader went away, as `slidax list | head` does: nothing is wrong.
        sys.stderr.close()
        raise typer.Exit(0) from None


def _parsed(changes: list[str]) -> dict[str, Any]:
    from slidax._errors import DefinitionError
    from slidax.scenarios.load import read_yaml

    parsed: dict[str, Any] = {}
    for change in changes:
        path, sign, value = change.partition("=")
        if not sign or not path.strip():
            raise DefinitionError(f"`--set {change}` needs the form PATH=VALUE, such as disturbance.scale=0")
        parsed[path.strip()] = read_yaml(value)
    return parsed


def _summary(parts: Scenario, finished: Run, import_s: float) -> dict[str, Any]:
    from slidax.metrics import summary

    outcome = finished.outcome
    timing = finished.timing
    return {
        "scenario": parts.name,
        "robot": parts.robot,
        "scheme": parts.scheme,
        "n": finished.joints,
        "period": parts.period,
        "t1": parts.t1,
        "outcome": outcome.kind,
        "stopped": None
        if outcome.ok
        else {
            "message": outcome.message,
            "t": outcome.t,
            "joint": outcome.joint,
            "error": outcome.error,
            "bound": outcome.bound,
        },
        "metrics": summary(finished),
        "timing": {
            "import_s": round(import_s, 4),
            "compile_s": round(timing.compile_s, 4) if timing else None,
            "run_s": round(timing.run_s, 4) if timing else None,
            "steps": round(parts.t1 / parts.period),
        },
    }


def _say_where(out: Path) -> None:
    typer.echo(f"The report is in {out.resolve() / 'report.html'}")


def _print_json(value: dict[str, Any]) -> None:
    import json

    # allow_nan=False: a NaN here would be a fault of ours, and is better a traceback than a lie.
    typer.echo(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False))


def _print_table(parts: Scenario, finished: Run, summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    metrics = summary["metrics"]
    table = Table(title=parts.description.title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    table.add_column("")
    for joint in range(finished.joints):
        table.add_column(f"joint {joint + 1}", justify="right")
    length, torque = _joined(finished.joint_units), _joined(parts.plant.robot.torque_units)
    end = (int(finished.tally.samples) - 1) * parts.period
    rows: list[tuple[str, list[float | None] | None]] = [
        (f"settled to |e| <= {band} [s]", [value if value < end else None for value in values])
        for band, values in metrics["settling_time"].items()
    ]
    rows += [
        (f"steady error [{length}]", metrics["steady_error"]),
        (f"peak torque [{torque}]", metrics["peak_torque"]),
        (f"initial torque [{torque}]", metrics["initial_torque"]),
        (f"torque step, max [{torque}]", metrics["max_torque_step"]),
        (f"torque step, steady [{torque}]", metrics["steady_torque_step"]),
        ("IAE (80)", metrics["iae"]),
        ("ECI (81)", metrics["eci"]),
        ("AICE (82)", metrics["aice"]),
        ("envelope margin [of its width]", metrics["envelope_margin"]),
    ]
    for name, values in rows:
        if values is not None:
            table.add_row(name, *("-" if value is None else f"{value:.4g}" for value in values))
    console = Console(markup=False, highlight=False)
    console.print(table)
    violations = metrics["envelope_violations"]
    kept = "no envelope promised" if violations is None else f"samples outside the envelope: {violations}"
    timing = summary["timing"]
    console.print(
        f"\n{parts.scheme} on {parts.robot}: outcome {finished.outcome.kind}, {kept}; "
        f"{int(finished.tally.samples)} samples in {timing['run_s']:.2f} s, compiled in {timing['compile_s']:.1f} s",
        soft_wrap=True,
    )


def _joined(units: tuple[str, ...]) -> str:
    return units[0] if len(set(units)) == 1 else ", ".join(units)
