"""Which engine runs a closed loop."""

from __future__ import annotations

import warnings
from typing import Literal, get_args

from slidax._errors import DefinitionError, shown
from slidax.codegen import cuda, llvm

Engine = Literal["auto", "native", "xla", "cuda"]
"""`native`: machine code of our own; `xla`: JAX's compiler, the reference; `auto`: the first where it can be had.

`cuda`: the same code on an NVIDIA card, for batches.
"""


def engine_for(engine: str) -> Literal["native", "xla"]:
    """The engine that runs one closed loop as it is asked for; a warning says so where it is another one.

    `cuda` is for batches: a card computes one run no faster than many. One run by itself, such as a row of a batch that
    is looked at again, then goes by the processor.

    - `engine`: what is asked for.

    Raises DefinitionError if there is none of that name.
    """
    _require_known(engine)
    if engine == "xla":
        return "xla"
    instead: Literal["native", "xla"] = "native" if llvm.available() else "xla"
    if engine == "cuda":
        warnings.warn(_sentence(instead, "`cuda` is for batches, and this is one run"), stacklevel=3)
    elif engine == "native" and instead == "xla":
        say_xla_instead("llvmlite is not installed: pip install 'slidax[native]'")
    return instead


def engine_for_batch(engine: str) -> Literal["native", "xla", "cuda"]:
    """The engine that runs a batch of closed loops; a warning says so where it is another one than is asked for.

    - `engine`: what is asked for.

    Raises DefinitionError if there is none of that name, or it is `cuda` and CuPy or a card is missing.
    """
    if engine != "cuda":
        return engine_for(engine)
    cuda.require_card()
    return "cuda"


def say_xla_instead(why: str) -> None:
    """Warns that XLA runs it.

    - `why`: the reason.
    """
    warnings.warn(_sentence("xla", why), stacklevel=4)


def _sentence(engine: str, why: str) -> str:
    return f"simulating with the engine `{engine}`, as {why}"


def _require_known(engine: str) -> None:
    if engine not in get_args(Engine):
        names = ", ".join(f"`{name}`" for name in get_args(Engine))
        raise DefinitionError(f"`engine` must be one of {names}; got {shown(engine)}")
