"""The error for a function that cannot become native code, in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from slidax._errors import DefinitionError


class NoNativeCodeError(DefinitionError):
    """A function holds something that there is no native code for; JAX itself may well run it.

    - `message`, `where`: as in `DefinitionError`.
    """


@contextmanager
def in_one_line(what: Callable[[], str]) -> Iterator[None]:
    """Turns any failure inside into a NoNativeCodeError that names it; a DefinitionError passes as it is.

    - `what`: says what was being made.

    Raises NoNativeCodeError.
    """
    try:
        yield
    except DefinitionError:
        raise
    except Exception as error:
        said = str(error).strip().partition("\n")[0]
        if not isinstance(error, NotImplementedError):
            said = f"{type(error).__name__}{said and ': '}{said}"
        raise NoNativeCodeError(f"no native code for {what()}: {said}") from error
