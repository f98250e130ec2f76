"""Engines of a closed loop: their protocol, the request that they take, and the choice among them."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, TypeVar, get_args

from slidax._errors import DefinitionError, shown
from slidax._types import State
from slidax.codegen import NoNativeCodeError, cuda, llvm

from .free_body import FreeBody
from .loop import Loop, LoopStart
from .run import Log, Timing

EngineName = Literal["auto", "native", "xla", "cuda"]
"""`native`: slidax's own machine code; `xla`: JAX's compiler, the reference; `auto`: `native` where available.

`cuda`: the native code on an NVIDIA card, for batches.
"""

T = TypeVar("T")


@dataclass(frozen=True)
class RunRequest:
    """One run of a closed loop, as every engine takes it.

    - `samples`: number of samples, from t = 0.
    - `log_every`: log one in so many samples; None logs none.
    - `progress`: show a bar; None shows it for long runs if standard error is a terminal.
    - `started`: start of the compilation, from `time.perf_counter`.
    """

    loop: Loop
    state0: State
    samples: int
    log_every: int | None
    progress: bool | None
    started: float = field(default_factory=time.perf_counter)

    @property
    def rows(self) -> int:
        """Number of logged samples of a complete run."""
        return 0 if self.log_every is None else -(-self.samples // self.log_every)


class EngineResult(NamedTuple):
    """A finished run: the carry after its last sample with the start of the loop, the log, the time spent.

    - `load`: motion of a released payload; None without one.
    """

    start: LoopStart
    log: Log | None
    timing: Timing
    load: FreeBody | None = None


class Engine(Protocol):
    """Run a closed loop from t = 0 until its last sample or its first fault.

    Raises DefinitionError if the loop may not start where it does, NoNativeCodeError if the engine has no machine code
    for a part of the loop.
    """

    def __call__(self, request: RunRequest) -> EngineResult: ...


def engine_for(name: str) -> Literal["native", "xla"]:
    """Return the engine that runs one closed loop, and warn if it differs from the requested one.

    `cuda` is for batches: one run on a card takes as long as many. A single run, such as a row of a batch that is
    repeated, then runs on the processor.

    Raises DefinitionError if the name is unknown.
    """
    if name not in get_args(EngineName):
        names = ", ".join(f"`{known}`" for known in get_args(EngineName))
        raise DefinitionError(f"`engine` must be one of {names}; got {shown(name)}")
    if name == "xla":
        return "xla"
    available: Literal["native", "xla"] = "native" if llvm.available() else "xla"
    if name == "cuda":
        _warn(available, "`cuda` is for batches, and this is one run", 3)
    elif name == "native" and available == "xla":
        _warn("xla", "llvmlite is not installed: pip install 'slidax[native]'", 3)
    return available


def engine_for_batch(name: str) -> Literal["native", "xla", "cuda"]:
    """Return the engine that runs a batch of closed loops, and warn if it differs from the requested one.

    Raises DefinitionError if the name is unknown, or is `cuda` and CuPy or a card is missing.
    """
    if name != "cuda":
        return engine_for(name)
    cuda.require_card()
    return "cuda"


def native_or_xla(
    requested: str, chosen: str, native: Callable[[], T], xla: Callable[[], T], *, stacklevel: int = 3
) -> T:
    """Run by machine code; without machine code for a part of the loop, warn and run by XLA.

    - `requested`, `chosen`: names of engines; `chosen` comes from `engine_for` or `engine_for_batch`.

    Raises NoNativeCodeError if the requested engine itself has no code for a part.
    """
    if chosen != "xla":
        try:
            return native()
        except NoNativeCodeError as error:
            if requested == chosen:
                raise
            _warn("xla", f"there is {error.message}", stacklevel)
    return xla()


def _warn(engine: str, reason: str, stacklevel: int) -> None:
    warnings.warn(f"simulating with the engine `{engine}`, as {reason}", stacklevel=stacklevel + 1)
