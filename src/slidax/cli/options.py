"""The options that several commands have."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

Named = Annotated[str, typer.Argument(help="A built-in scenario by name, or a YAML file.")]

Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="PATH=VALUE", help="Set a field, as YAML; repeatable.")
]

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]

Engine = StrEnum("Engine", ["auto", "native", "xla", "cuda"])
"""What computes a run."""
