"""The command line. Everything heavy is imported inside the commands, so that `--help` answers at once."""

from __future__ import annotations

import atexit
import gc
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
export = typer.Typer(help="A scheme as code for a robot.", no_args_is_help=True, rich_markup_mode="rich")
app.add_typer(export, name="export")
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field, as YAML; repeatable.")
]


Kind = StrEnum(
    "Kind",
    ["schemes", "robots", "trajectories", "disturbances", "estimators", "performance", "scenarios"],
)
"""What `slidax list` can list."""

Engine = StrEnum("Engine", ["auto", "native", "xla"])
"""What computes a run."""

Disturbance = StrEnum("Disturbance", ["stated", "off", "both"])
"""Which readings of the paper's disturbance `slidax reproduce` computes."""


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
    changes: Changes = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write a report, a Parquet log and figures there.")] = None,
    engine: Annotated[Engine | None, typer.Option(help="What computes; the scenario's own if not given.")] = None,
) -> None:
    """One closed-loop run: its metrics as a table, as JSON, or as a report.

    `--set scheme.name=NAME` puts another scheme in the place of the scenario's own; `slidax list schemes`
    shows them. Of the file's scheme `performance`, `overshoot`, `bound` and `sampled_data` are kept, as far as NAME has
    them; all else takes NAME's own defaults, which are the paper's where it prints any. Other `--set scheme.…` apply
    after that.

    Exit code 0: the run reached its end inside its envelope; 2: the scenario cannot be; 3: it left its envelope, also
    if it came back, or became infinite.
    """
    with _errors_as_lines():
        _prepare()
        from slidax.scenarios import load
        from slidax.terminal import print_run, run_as_json

        chosen = {} if engine is None else {"simulation.engine": engine.value}
        parts = load(scenario, _parsed(changes or []) | chosen)
        if out is not None:
            from slidax.reports import parquet, write_run_report

            parquet.require_pyarrow()
        import_s = time.perf_counter() - STARTED
        finished = parts.simulate(log_every=0 if out is not None else None)
        summary = run_as_json(parts, finished, import_s)
        if out is not None:
            parquet.write_log(finished, out / "log.parquet")
            write_run_report(parts, finished, out, command=shlex.join(["slidax", *sys.argv[1:]]))
        if json:
            _print_json(summary)
        else:
            print_run(parts, finished, summary)
            if out is not None:
                _say_where(out)
        if not finished.outcome.ok:
            typer.echo(finished.outcome.message, err=True)
            raise typer.Exit(OUTCOME)


@app.command(epilog="Example:  slidax compare example-4.1 --schemes cftsmppc,ftsmc,sfsmc --out comparison")
def compare(
    scenario: Annotated[str, typer.Argument(help="A built-in scenario by name, or a YAML file.")],
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="The schemes to compare; all if not given.")] = "",
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field for all; repeatable.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option(help="Write a report, its figures and results.json there.")] = None,
) -> None:
    """Several schemes on the same task: their metrics beside each other, the best in bold.

    Each takes the place of the scenario's scheme as with `slidax run --set scheme.name=NAME`; each `--set` applies to
    all of them after that.

    Exit code 0: at least one run reached its end; 2: something asked for cannot be; 3: none reached its end.
    """
    with _errors_as_lines():
        _prepare()
        from slidax.reports import results, write_comparison
        from slidax.terminal import print_comparison

        parts = _switched(scenario, schemes, _parsed(changes or []))
        runs = {name: (each, each.simulate(log_every=0 if out else None)) for name, each in parts.items()}
        if out is not None:
            write_comparison(runs, out, command=shlex.join(["slidax", *sys.argv[1:]]))
        if json:
            _print_json(results(runs))
        else:
            print_comparison(runs)
            if out is not None:
                _say_where(out)
        if not any(finished.outcome.ok for _, finished in runs.values()):
            typer.echo("none of the runs reached its end", err=True)
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


@export.command("c", epilog="Example:  slidax export c example-4.1-1khz --out law")
def export_c(
    scenario: Annotated[str, typer.Argument(help="A built-in scenario by name, or a YAML file.")],
    out: Annotated[Path, typer.Option(help="The folder of the project.")],
    name: Annotated[str | None, typer.Option(help="Of the law in C; after the scenario if not given.")] = None,
    single: Annotated[bool, typer.Option("--float", help="Floats in the place of doubles.")] = False,
    changes: Changes = None,
) -> None:
    """The control law as a C99 project: library, tests against Python, latency benchmark, example, C++ wrapper."""
    with _errors_as_lines():
        _prepare()
        from slidax import deploy, scenarios

        parts = scenarios.load(scenario, _parsed(changes or []))
        made = deploy.export_c(parts, out, name=name, single=single, command=shlex.join(["slidax", *sys.argv[1:]]))
        typer.echo(f"{made.law} in {made.real}s, at most {made.stack} bytes of stack: {out.resolve() / 'README.md'}")


@app.callback(invoke_without_command=True)
def _top(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        import slidax

        typer.echo(f"slidax {slidax.__version__}")
        raise typer.Exit


def main() -> None:
    """The entry point of the `slidax` command."""
    # Most of what is made lives to the end; to look through it for garbage takes a quarter of a short command.
    gc.set_threshold(100_000, 50, 50)
    atexit.register(gc.freeze)
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


def _switched(scenario: str, schemes: str, changes: dict[str, Any]) -> dict[str, Scenario]:
    """The scenario with each of the schemes; an error in one says in which."""
    from slidax._errors import DefinitionError
    from slidax.scenarios import catalogue, load

    if "scheme.name" in changes:
        raise DefinitionError("`--set scheme.name` is not for comparing; name the schemes with `--schemes`")
    names = [name.strip() for name in schemes.split(",") if name.strip()] if schemes else list(catalogue()["schemes"])
    if not names:
        raise DefinitionError("`--schemes` names none; give some, such as `--schemes cftsmppc,ftsmc`")
    found = {}
    for name in dict.fromkeys(names):
        try:
            found[name] = load(scenario, {"scheme.name": name, **changes})
        except DefinitionError as error:
            if name not in catalogue()["schemes"] or not changes:
                raise
            raise DefinitionError(f"with the scheme `{name}`: {error}") from None
    return found


def _say_where(out: Path) -> None:
    typer.echo(f"The report is in {out.resolve() / 'report.html'}")


def _print_json(value: dict[str, Any]) -> None:
    import json

    # allow_nan=False: a NaN here would be a fault of ours, and is better a traceback than a lie.
    typer.echo(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False))
