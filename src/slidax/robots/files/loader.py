"""MuJoCo's reader of robot files, with its errors and warnings converted to ours."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from slidax._errors import DefinitionError


def mujoco() -> Any:
    """Return the package; raise DefinitionError, with the way to install it, if it is missing."""
    try:
        import mujoco
    except ImportError as error:
        raise DefinitionError("MuJoCo, which reads robot files, is needed: pip install 'slidax[robots]'") from error
    return mujoco


@contextmanager
def reading() -> Iterator[list[str]]:
    """Convert MuJoCo's errors into DefinitionError, and collect its warnings in the yielded list.

    By default MuJoCo prints warnings and writes a log into the working directory.
    """
    library = mujoco()
    messages: list[str] = []
    before = library.get_mju_user_warning()
    try:
        library.set_mju_user_warning(messages.append)
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            yield messages
        messages.extend(str(warning.message) for warning in raised)
    except DefinitionError:
        raise
    # Its errors are of several kinds, and what they are is not documented.
    except Exception as error:
        raise DefinitionError(f"MuJoCo does not read the robot file: {_one_line(error)}") from error
    finally:
        library.set_mju_user_warning(before)


def _one_line(error: Exception) -> str:
    """The message without MuJoCo's word "Error" and without line ends."""
    lines = [line.strip() for line in str(error).splitlines()]
    return "; ".join(line for line in lines if line).removeprefix("Error: ").removeprefix("XML Error: ")
