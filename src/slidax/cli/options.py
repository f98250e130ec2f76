"""The options that several commands have."""

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
"""What computes a run."""

Tip = Annotated[str | None, typer.Option(help="The link, body or site of the tip, where a file has several ends.")]

Gravity = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Gravity in the base frame (m/s²), for a mounted arm.")
]

Inertias = Annotated[
    str | None,
    typer.Option(help="Inertias in the file that no body can have: `nearest` replaces, `strict` refuses all."),
]

Locked = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT=POSITION", help="A joint in the file that does not move (rad or m); repeatable."),
]


def named_arm(
    robot: str, tip: str | None, inertias: str | None, locked: list[str] | None, gravity: str | None
) -> tuple[Any, dict[str, Any]]:
    """Return the arm that a command's options name, and its description.

    - `robot`: a ready arm by its name, or a file.
    - `tip`, `inertias`, `locked`, `gravity`: the options of these names.

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
    """The numbers of an option.

    - `option`: its name, for messages.
    - `text`: numbers with commas between them.

    Raises DefinitionError if one is no number.
    """
    from slidax._errors import DefinitionError, shown

    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise DefinitionError(
            f"`{option}` needs numbers with commas between them, such as 1,-1,1; got {shown(text)}"
        ) from None


def positions(option: str, texts: list[str]) -> dict[str, float]:
    """The positions of joints of an option.

    - `option`: its name, for messages.
    - `texts`: each as JOINT=POSITION.

    Raises DefinitionError if one has another form, or a joint has two positions.
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
