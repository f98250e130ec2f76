"""Which engine runs a closed loop."""

from __future__ import annotations

import warnings
from typing import Literal, get_args

from slidax._errors import DefinitionError, shown
from slidax.codegen import llvm

Engine = Literal["auto", "native", "xla"]
"""`native`: machine code of our own; `xla`: JAX's compiler, the reference; `auto`: the first where it can be had."""


def engine_for(engine: str) -> Literal["native", "xla"]:
    """The engine that runs what is asked for; a warning says so where it is another one.

    - `engine`: what is asked for.

    Raises DefinitionError if there is none of that name.
    """
    if engine not in get_args(Engine):
        names = ", ".join(f"`{name}`" for name in get_args(Engine))
        raise DefinitionError(f"`engine` must be one of {names}; got {shown(engine)}")
    if engine == "xla" or llvm.available():
        return "xla" if engine == "xla" else "native"
    if engine == "native":
        say_xla_instead("llvmlite is not installed: pip install 'slidax[native]'")
    return "xla"


def say_xla_instead(why: str) -> None:
    """Warns that XLA runs it.

    - `why`: the reason.
    """
    warnings.warn(f"simulating with the engine `xla`, as {why}", stacklevel=4)
