"""`slidax compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Named
from .session import OUTCOME, command_line, errors_as_lines, parsed, prepare, print_json, say_where

if TYPE_CHECKING:
    from slidax.scenarios import Scenario


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
    all. Samples of a scheme without an envelope are counted against the scenario's envelope.

    Exit code 0: at least one run reached its end; 2: the request is invalid; 3: none reached its end.
    """
    with errors_as_lines():
        prepare()
        from slidax.papers.indices import INDICES
        from slidax.reports import Rival, results, write_comparison
        from slidax.terminal import print_comparison

        values = parsed(changes or [])
        parts = _switched(scenario, schemes, values)
        judge = _judge(scenario, values)
        rivals = {name: Rival.simulated(each, judge, logged=out is not None) for name, each in parts.items()}
        if out is not None:
            write_comparison(rivals, out, also=INDICES, command=command_line())
        if json:
            print_json(results(rivals, INDICES))
        else:
            print_comparison(rivals)
            if out is not None:
                say_where(out)
        if not any(rival.run.outcome.ok for rival in rivals.values()):
            typer.echo("none of the runs reached its end", err=True)
            raise typer.Exit(OUTCOME)


def _switched(scenario: str, schemes: str, changes: dict[str, Any]) -> dict[str, Scenario]:
    """The scenario with each scheme; an error names the scheme."""
    from slidax._errors import DefinitionError
    from slidax.scenarios import catalogue, load
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
    """The scenario with its own scheme, whose envelope judges schemes without one."""
    from slidax._errors import DefinitionError
    from slidax.scenarios import load

    try:
        return load(scenario, changes)
    except DefinitionError:
        # A field of the other schemes that its own scheme lacks.
        return load(scenario)
