"""Error for functions that cannot become native code, in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from slidax._errors import DefinitionError


class NoNativeCodeError(DefinitionError):
    """A function uses an operation without native code; JAX itself may well run it."""


@contextmanager
def in_one_line(what: Callable[[], str]) -> Iterator[None]:
    """Turn every failure inside into a NoNativeCodeError; a DefinitionError passes.

    - `what`: name of the object, for the message.

    Raises NoNativeCodeError.
    """
    try:
        yield
    except DefinitionError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0]
        if not isinstance(error, NotImplementedError):
            reason = f"{type(error).__name__}{reason and ': '}{reason}"
        raise NoNativeCodeError(f"no native code for {what()}: {reason}") from error
