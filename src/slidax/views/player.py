"""The clock of a replay."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

TICK = 1 / 60
"""How often a new frame is looked for while it plays [s]."""


class Player(threading.Thread):
    """Lets the time of a run pass, at a speed of choice, from its start to its end and again.

    - `start_time`, `end_time`: of the run [s].
    - `show`: called from the player's own thread with each new time [s].
    """

    def __init__(self, start_time: float, end_time: float, show: Callable[[float], None]) -> None:
        super().__init__(name="slidax replay", daemon=True)
        self.start_time, self.end_time = start_time, end_time
        self.playing = False
        self.speed = 1.0
        self._show = show
        self._time = start_time
        self._changed = True
        self._lock = threading.Lock()
        self._end = threading.Event()

    @property
    def time(self) -> float:
        """The time of the run that is shown [s]."""
        return self._time

    def seek(self, t: float) -> None:
        """Goes to a time.

        - `t`: s; before the start and after the end these are meant.
        """
        with self._lock:
            self._time = min(max(t, self.start_time), self.end_time)
            self._changed = True

    def stop(self) -> None:
        """Ends the thread."""
        self._end.set()
        if self.is_alive() and threading.current_thread() is not self:
            self.join()

    def run(self) -> None:
        """What the thread does."""
        last = time.perf_counter()
        while not self._end.wait(TICK):
            now = time.perf_counter()
            self.advance(now - last)
            last = now

    def advance(self, elapsed: float) -> None:
        """What happens at a tick of the clock.

        - `elapsed`: since the last tick [s].
        """
        with self._lock:
            if self.playing:
                t = self._time + elapsed * self.speed
                # The last frame is seen before it begins again.
                self._time = self.start_time if self._time >= self.end_time else min(t, self.end_time)
            changed, self._changed = self._changed or self.playing, False
            t = self._time
        if changed:
            self._show(t)
