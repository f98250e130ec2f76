"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any

import typer

Named = Annotated[str, typer.Argument(help="A built-in scenario by name, or a YAML file.")]

Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field, as YAML; repeatable.")
]

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]

Engine = StrEnum("Engine", ["auto", "native", "xla", "cuda"])
"""Engines that compute a run."""

Tip = Annotated[str | None, typer.Option(help="Link, body or site of the tip, if a file has several ends.")]

Gravity = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Gravity in the base frame [m/s²], for a mounted arm.")
]

Inertias = Annotated[
    str | None,
    typer.Option(help="Physically impossible inertias in the file: `nearest` replaces, `strict` refuses them."),
]

Locked = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT=POSITION", help="Lock a joint of the file [rad or m]; repeatable."),
]


def named_arm(
    robot: str, tip: str | None, inertias: str | None, locked: list[str] | None, gravity: str | None
) -> tuple[Any, dict[str, Any]]:
    """Return the arm from the options `robot`, `tip`, `inertias`, `locked` and `gravity`, and its description.

    Raises DefinitionError if there is no such arm, or an option does not fit it.
    """
    from slidax.scenarios import named_robot

    return named_robot(
        robot,
        tip=tip,
        inertias=inertias,
        locked=positions("--locked", locked or []),
        gravity=None if gravity is None else numbers("--gravity", gravity),
    )


def numbers(option: str, text: str) -> list[float]:
    """Parse the comma-separated numbers in the `text` of an `option`.

    Raises DefinitionError if one is not a number.
    """
    from slidax._errors import DefinitionError, shown

    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise DefinitionError(f"`{option}` needs comma-separated numbers, such as 1,-1,1; got {shown(text)}") from None


def positions(option: str, texts: list[str]) -> dict[str, float]:
    """Parse joint positions in the `texts` of an `option`, each of the form JOINT=POSITION.

    Raises DefinitionError for another form, or if a joint has two positions.
    """
    from slidax._errors import DefinitionError, plain, shown

    places: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            position = float(value)
        except ValueError:
            raise DefinitionError(
                f"`{option}` needs the form JOINT=POSITION, such as finger=0.04; got {shown(text)}"
            ) from None
        if places.setdefault(name.strip(), position) != position:
            raise DefinitionError(f"`{option}` names joint `{plain(name.strip())}` twice, with different positions")
    return places
