"""Read a log back, even an incomplete one."""

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
    """Content of an MCAP file written by slidax.

    - `metadata`: of the run, as texts.
    - `attachments`: files by name.
    - `law`: columns with one row per answer of the law; signals as `signal:NAME`.
    - `arm`: columns with one row per tick of a simulated arm; no rows for a real one.
    - `whole`: False if the writer was killed and the file has no end.
    """

    path: Path
    channels: Channels
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    law: dict[str, np.ndarray]
    arm: dict[str, np.ndarray]
    whole: bool

    @property
    def name(self) -> str:
        """Name of the scenario; `log` if the metadata have none."""
        return self.metadata.get("scenario", "log")

    @property
    def scenario(self) -> str:
        """The scenario as YAML.

        Raises DefinitionError if it is missing or damaged.
        """
        if SCENARIO not in self.attachments:
            raise DefinitionError(f"`{self.path}` does not contain `{SCENARIO}`")
        try:
            return self.attachments[SCENARIO].decode()
        except UnicodeDecodeError:
            raise DefinitionError(f"`{self.path}` is damaged: its `{SCENARIO}` is no UTF-8 text") from None

    @property
    def files(self) -> dict[str, bytes]:
        """The files that the scenario names."""
        return {name: content for name, content in self.attachments.items() if name != SCENARIO}


def read_mcap(path: Path) -> SavedLog:
    """Read a log of slidax.

    Raises DefinitionError if it cannot be read, is damaged, has another writer, or mcap is not installed.
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
        raise DefinitionError(f"`{path}` is not a slidax log: `slidax run SCENARIO --out log.mcap` writes one")
    try:
        channels = Channels.of_text(metadata["channels"])
        sides = [_columns(contents.bodies, side) for side in (channels.law(), channels.arm())]
    except ValueError as error:
        raise DefinitionError(f"`{path}` is damaged: {error}; record or run it again") from None
    return SavedLog(path, channels, metadata, attachments, sides[0], sides[1], contents.whole)


def _columns(messages: dict[str, list[bytes]], kinds: list[Message]) -> dict[str, np.ndarray]:
    # A chunk holds complete answers, but the last one may be cut if it was not ended by a flush.
    rows = min(len(messages.get(kind.topic, ())) for kind in kinds)
    columns: dict[str, np.ndarray] = {}
    for kind in kinds:
        columns |= kind.unpacked(messages.get(kind.topic, [])[:rows])
    return columns
