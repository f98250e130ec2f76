"""`slidax compare`."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import AsJson, Named
from .session import OUTCOME, errors_as_lines, parsed, prepare, print_json, say_where

if TYPE_CHECKING:
    from slidax.scenarios import Scenario


def compare(
    scenario: Named,
    schemes: Annotated[str, typer.Option(metavar="A,B,C", help="The schemes to compare; all if not given.")] = "",
    changes: Annotated[
        list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field for all; repeatable.")
    ] = None,
    json: AsJson = False,
    out: Annotated[Path | None, typer.Option(help="Write a report, its figures and results.json there.")] = None,
) -> None:
    """Several schemes on the same task: their metrics side by side, the best in bold, and in which form each ran.

    Each takes the place of the scenario's scheme as with `slidax run --set scheme.name=NAME`; each `--set` applies to
    all of them after that. The samples of a scheme without an envelope are counted against the scenario's own.

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
            write_comparison(rivals, out, also=INDICES, command=shlex.join(["slidax", *sys.argv[1:]]))
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
    """The scenario with each of the schemes; an error in one says in which."""
    from slidax._errors import DefinitionError
    from slidax.scenarios import catalogue, load
    from slidax.scenarios.schemes import PRESETS

    if "scheme.name" in changes:
        raise DefinitionError("`--set scheme.name` is not for comparing; name the schemes with `--schemes`")
    every = [name for name, preset in PRESETS.items() if preset.complete]
    names = [name.strip() for name in schemes.split(",") if name.strip()] if schemes else every
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


def _judge(scenario: str, changes: dict[str, Any]) -> Scenario:
    """The scenario with its own scheme, whose envelope counts for schemes without one."""
    from slidax._errors import DefinitionError
    from slidax.scenarios import load

    try:
        return load(scenario, changes)
    except DefinitionError:
        # A change that the rivals know and its own scheme does not.
        return load(scenario)
