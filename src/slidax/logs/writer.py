"""A log as an MCAP file, and the same messages live."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .channels import Channels
from .message import Message
from .needed import require_writer

SECOND = 1_000_000_000

SCENARIO = "scenario.yaml"
"""The attachment that says what was run."""

METADATA = "slidax"
"""The name of the record with all else."""

Columns = Mapping[str, np.ndarray]


class _Sink:
    """A file that remembers its first error instead of raising it.

    foxglove-sdk, which writes to it, ends with a panic where the file fails, as on a full disk.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self._file = path.open("wb", buffering=0)
        self._error: OSError | None = None

    def write(self, data: bytes) -> int:
        """Write all of the data, or none of it after an error."""
        left = memoryview(data)
        while left and self._error is None:
            try:
                left = left[self._file.write(left) or 0 :]
            except OSError as error:
                self._error = error
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to another place."""
        return self._file.seek(offset, whence)

    def flush(self) -> None:
        """Do nothing, as nothing is held back."""

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError as error:
            self._error = self._error or error

    def require_written(self) -> None:
        """Raise an OSError with the file's name if something could not be written."""
        if self._error is not None:
            raise OSError(self._error.errno, self._error.strerror, str(self._path)) from None


class LogWriter:
    """Writes messages in chunks that are whole as soon as they are flushed, so that a file without an end can be read.

    - `path`: of the file; None for live data alone.
    - `channels`: what it has.
    - `metadata`: of the run, as texts.
    - `attachments`: files by name, `scenario.yaml` among them.
    - `start`: time 0 by the wall clock [ns].
    - `port`: of a server for live data on this machine alone; None for none.

    Raises DefinitionError if foxglove-sdk is not installed or the port is taken, OSError if the file cannot be written.
    """

    def __init__(
        self,
        path: Path | None,
        channels: Channels,
        metadata: Mapping[str, str],
        attachments: Mapping[str, bytes],
        *,
        start: int = 0,
        port: int | None = None,
    ) -> None:
        foxglove = require_writer()
        from foxglove.mcap import MCAPCompression, MCAPWriteOptions

        self._start = start
        # A context of its own: nothing else that the process may log ends up here. Held, as all goes with it.
        self._context = context = foxglove.Context()
        self._server: Any = None
        if port is not None:
            try:
                self._server = foxglove.start_server(name="slidax", host="127.0.0.1", port=port, context=context)
            except Exception as error:
                from slidax._errors import DefinitionError

                raise DefinitionError(f"there can be no server at 127.0.0.1:{port}: {error}") from None
        self._file: Any = None
        self._sink: _Sink | None = None
        if path is not None:
            # Chunks end where they are flushed; each is written at once, so that none is left half done.
            options = MCAPWriteOptions(
                compression=MCAPCompression.Lz4,
                profile="ros2",
                chunk_size=None,
                disable_seeking=True,
                compression_threads=0,
            )
            self._sink = _Sink(path)
            self._file = foxglove.open_mcap(self._sink, context=context, writer_options=options)
            self._file.write_metadata(METADATA, {**metadata, "channels": channels.as_text()})
            for name, content in attachments.items():
                media = "application/yaml" if name.endswith(".yaml") else "application/octet-stream"
                self._file.attach(log_time=start, create_time=start, name=name, media_type=media, data=content)
        self._law = [(message, _opened(foxglove, message, context)) for message in channels.law()]
        self._arm = [(message, _opened(foxglove, message, context)) for message in channels.arm()]

    def law(self, columns: Columns) -> None:
        """Answers of the law.

        - `columns`: by name, with the answer as first axis.
        """
        self._write(self._law, columns, columns["t"])

    def arm(self, columns: Columns) -> None:
        """Ticks of a simulated arm.

        - `columns`: by name, with the tick as first axis.
        """
        self._write(self._arm, columns, columns["true_t"])

    def flush(self) -> None:
        """All that was written is in the file, and stays there whatever happens to this process.

        Raises OSError if the file cannot be written.
        """
        if self._file is not None:
            self._file.flush()
            self._require_written()

    def close(self) -> None:
        """Ends the file and the server.

        Raises OSError if the file cannot be written.
        """
        if self._server is not None:
            self._server.stop()
        if self._file is not None:
            self._file.close()
            if self._sink is not None:
                self._sink.close()
            self._require_written()

    def _require_written(self) -> None:
        if self._sink is not None:
            self._sink.require_written()

    def _write(self, channels: list[tuple[Message, Any]], columns: Columns, t: np.ndarray) -> None:
        if not len(t):
            return
        stamps = self._start + np.round(t * SECOND).astype(np.int64)
        times = stamps.tolist()
        # Without the wrapper around it, which takes as long as the writing.
        packed = [(channel.base.log, message.packed(stamps, columns)) for message, channel in channels]
        # In the order of time, as a reader expects it.
        for k, time in enumerate(times):
            for log, messages in packed:
                log(messages[k], time)


def _opened(foxglove: Any, message: Message, context: Any) -> Any:
    schema = foxglove.Schema(name=message.type, encoding="ros2msg", data=message.definition.encode())
    return foxglove.Channel(message.topic, schema=schema, message_encoding="cdr", context=context)
