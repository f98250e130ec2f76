"""Methods whose function is in a package above the class."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any


class MethodAbove:
    """A method that imports its function when it is looked up; the object is its first argument.

    Data classes lie below the packages that draw and analyse them, and must not import these.

    - `place`: module and function, such as `slidax.studies.by_path:sweep`.
    """

    def __init__(self, place: str) -> None:
        self.module, _, self.function = place.partition(":")

    def __get__(self, owner: Any, kind: type | None = None) -> Any:
        function = getattr(import_module(self.module), self.function)
        if owner is None:
            return function
        method = partial(function, owner)
        method.__doc__ = function.__doc__
        return method
