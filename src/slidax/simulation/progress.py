"""Progress bar for long runs."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

PATIENCE = 2.0
"""Expected duration [s] from which a run shows its bar."""


class Progress:
    """Count finished pieces of work, and draw a bar once they are expected to take long.

    - `shown`: True draws from the start, False never, None for long work if standard error is a terminal.
    """

    def __init__(self, total: int, shown: bool | None) -> None:
        self._total = total
        self._shown = shown
        self._done = 0
        self._bar: Any = None
        self._started = time.perf_counter()

    def __enter__(self) -> Progress:
        if self._shown:
            self._draw()
        return self

    def advance(self) -> None:
        """Count one more finished piece."""
        self._done += 1
        if self._bar is None and self._shown is None and sys.stderr.isatty():
            expected = (time.perf_counter() - self._started) * self._total / self._done
            if expected > PATIENCE:
                self._draw()
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done)

    def _draw(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        columns = (TextColumn("simulating"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
        console = Console(stderr=True)
        # Without a terminal, rich draws only what remains at the end.
        self._bar = Bar(*columns, console=console, transient=console.is_terminal)
        self._bar.start()
        self._task = self._bar.add_task("", total=self._total, completed=self._done)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
