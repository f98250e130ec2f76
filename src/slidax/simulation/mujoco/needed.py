"""Access to the optional package MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from slidax._errors import DefinitionError


def mujoco() -> Any:
    """Return the package. Raises DefinitionError if it is not installed."""
    try:
        import mujoco as package
    except ImportError:
        raise DefinitionError(
            "a MujocoPlant needs MuJoCo, which is not installed: pip install 'slidax[robots]'"
        ) from None
    return package


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo's warnings off the terminal and out of its log file; the outcome has the facts."""
    package = mujoco()
    before = package.get_mju_user_warning()
    package.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        package.set_mju_user_warning(before)
