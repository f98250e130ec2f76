"""Simulation engines: their protocol, request and result, the choice among them, and the progress bar."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Literal, NamedTuple, Protocol, TypeVar, get_args

from slidax.codegen import cuda, llvm
from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.trace.tracing import located_tracing_errors
from slidax.core.errors import DefinitionError, short_repr
from slidax.core.types import State

from .loop import ClosedLoop, LoopStart
from .plant import FreeBody
from .run import Log, RunTiming

EngineName = Literal["auto", "native", "xla", "cuda"]
"""`native`: slidax's own machine code; `xla`: JAX's compiler, against which the others are tested; `auto`: `native`
where available.

`cuda`: the native code on an NVIDIA GPU, for batches.
"""

T = TypeVar("T")


@dataclass(frozen=True)
class RunRequest:
    """Request to an engine for one run of a closed loop.

    - `samples`: number of samples, from t = 0.
    - `log_every`: n to log every n-th sample; None for no log.
    - `progress`: True to show a progress bar; None shows it for long runs if standard error is a terminal.
    - `started`: time at which the compilation starts, from `time.perf_counter` [s].
    """

    loop: ClosedLoop
    state0: State
    samples: int
    log_every: int | None
    progress: bool | None
    started: float = field(default_factory=time.perf_counter)

    @property
    def rows(self) -> int:
        """Number of samples in the log of a complete run."""
        return 0 if self.log_every is None else -(-self.samples // self.log_every)


class EngineResult(NamedTuple):
    """A finished run.

    - `start`: the loop's last state (`Carry`), then envelope, reference and holding torque at t = 0.
    - `log`: logged samples; None without a log.
    - `load`: motion of a released payload; None without one.
    """

    start: LoopStart
    log: Log | None
    timing: RunTiming
    load: FreeBody | None = None


class Engine(Protocol):
    """Function that runs a closed loop from t = 0 until its last sample or its first fault.

    Raises DefinitionError if the initial state is invalid, NoNativeCodeError if the engine has no machine code for a
    part of the loop.
    """

    def __call__(self, request: RunRequest) -> EngineResult: ...


def engine_for(name: str) -> Literal["native", "xla"]:
    """Return the engine for a single run, and warn if it differs from the requested one.

    - `name`: "auto", "native", "xla" or "cuda".

    A single run never uses "cuda", since one run takes as long as a whole batch on a GPU. A study in which nothing
    varies also makes a single run.

    Raises DefinitionError if the name is unknown.
    """
    if name not in get_args(EngineName):
        names = ", ".join(f"`{known}`" for known in get_args(EngineName))
        raise DefinitionError(f"`engine` must be one of {names}; got {short_repr(name)}")
    if name == "xla":
        return "xla"
    available: Literal["native", "xla"] = "native" if llvm.available() else "xla"
    if name == "cuda":
        _warn(available, "`cuda` is for batches, and this is one run", 3)
    elif name == "native" and available == "xla":
        _warn("xla", "llvmlite is not installed: pip install 'slidax[native]'", 3)
    return available


def engine_for_batch(name: str) -> Literal["native", "xla", "cuda"]:
    """Return the engine for a batch of runs, and warn if it differs from the requested one.

    Raises DefinitionError if the name is unknown, or if it is `cuda` and CuPy or a GPU is missing.
    """
    if name != "cuda":
        return engine_for(name)
    cuda.require_card()
    return "cuda"


def native_or_xla(
    requested: str, chosen: str, native: Callable[[], T], xla: Callable[[], T], *, stacklevel: int = 3
) -> T:
    """Return the result of `native`; if the loop has no machine code, warn and return the result of `xla`.

    - `requested`: the user's choice of the engine, such as "auto".
    - `chosen`: the engine that `engine_for` or `engine_for_batch` returned; "xla" skips `native`.
    - `native`, `xla`: functions that run the loop as machine code and by XLA.

    Raises NoNativeCodeError if a part has no machine code and `requested` equals `chosen`. Raises DefinitionError if
    Python code of the user branches on the values of arrays; the message has the source line.
    """
    if chosen != "xla":
        try:
            return native()
        except NoNativeCodeError as error:
            if requested == chosen:
                raise
            _warn("xla", f"there is {error.message}", stacklevel)
    with located_tracing_errors():
        return xla()


def _warn(engine: str, reason: str, stacklevel: int) -> None:
    warnings.warn(f"simulating with the engine `{engine}`, because {reason}", stacklevel=stacklevel + 1)


PATIENCE = 2.0
"""Expected duration [s] above which the progress bar is drawn."""


class Progress:
    """Count finished pieces of work, and draw a progress bar if all of them are expected to take long.

    - `total`: number of all pieces.
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
        # Without a terminal, rich draws only the final state, so the bar must not be transient.
        self._bar = Bar(*columns, console=console, transient=console.is_terminal)
        self._bar.start()
        self._task = self._bar.add_task("", total=self._total, completed=self._done)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
