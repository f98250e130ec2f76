"""A log read back, also one that has no end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError

from .channels import Channels
from .message import Message
from .records import read_contents
from .writer import METADATA, SCENARIO


@dataclass(frozen=True)
class SavedLog:
    """What an MCAP file of ours has.

    - `path`: of the file.
    - `channels`: what it has.
    - `metadata`: of the run, as texts.
    - `attachments`: files by name.
    - `law`: columns with an answer of the law a row, by name; signals as `signal:NAME`.
    - `arm`: columns with a tick of a simulated arm a row; without rows for a real one.
    - `whole`: whether the file has an end; one whose writer was killed has none.
    """

    path: Path
    channels: Channels
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]
    whole: bool

    @property
    def scenario(self) -> str:
        """The scenario as YAML.

        Raises DefinitionError if there is none in the file, or it is damaged.
        """
        if SCENARIO not in self.attachments:
            raise DefinitionError(f"`{self.path}` has no `{SCENARIO}` in it, which says what was run")
        try:
            return self.attachments[SCENARIO].decode()
        except UnicodeDecodeError:
            raise DefinitionError(f"`{self.path}` is damaged: its `{SCENARIO}` is no UTF-8 text") from None

    @property
    def files(self) -> dict[str, bytes]:
        """The files that the scenario names."""
        return {name: content for name, content in self.attachments.items() if name != SCENARIO}


def read_mcap(path: Path) -> SavedLog:
    """Return a log of ours.

    - `path`: the file.

    Raises DefinitionError if it cannot be read, is damaged or is none of ours, or mcap is not installed.
    """
    contents = read_contents(path)
    metadata: dict[str, str] | None = None
    attachments: dict[str, bytes] = {}
    for record in contents.others:
        kind = type(record).__name__
        if kind == "Metadata" and record.name == METADATA:
            metadata = record.metadata
        elif kind == "Attachment":
            attachments[record.name] = record.data
    if metadata is None or "channels" not in metadata:
        raise DefinitionError(f"`{path}` is no log of slidax: `slidax run SCENARIO --out log.mcap` writes one")
    try:
        channels = Channels.of_text(metadata["channels"])
        sides = [_columns(contents.bodies, side) for side in (channels.law(), channels.arm())]
    except ValueError as error:
        raise DefinitionError(f"`{path}` is damaged: {error}; record or run it again") from None
    return SavedLog(path, channels, metadata, attachments, sides[0], sides[1], contents.whole)


def _columns(messages: dict[str, list[bytes]], kinds: list[Message]) -> dict[str, np.ndarray]:
    # A chunk holds whole answers, but the last one may be cut where something else than a flush ended it.
    rows = min(len(messages.get(kind.topic, ())) for kind in kinds)
    columns: dict[str, np.ndarray] = {}
    for kind in kinds:
        columns |= kind.unpacked(messages.get(kind.topic, [])[:rows])
    return columns
