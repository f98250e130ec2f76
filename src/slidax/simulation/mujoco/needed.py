"""MuJoCo, where it is installed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from slidax._errors import DefinitionError


def mujoco() -> Any:
    """The package.

    Raises DefinitionError if it is not installed.
    """
    try:
        import mujoco as package
    except ImportError:
        raise DefinitionError(
            "a MujocoPlant needs MuJoCo, which is not installed: pip install 'slidax[robots]'"
        ) from None
    return package


@contextmanager
def quiet() -> Iterator[None]:
    """Keeps MuJoCo's warnings off the terminal and out of a file that it would begin; the outcome says it all."""
    package = mujoco()
    before = package.get_mju_user_warning()
    package.set_mju_user_warning(_nothing)
    try:
        yield
    finally:
        package.set_mju_user_warning(before)


def _nothing(message: str) -> None:
    """Takes a warning."""
