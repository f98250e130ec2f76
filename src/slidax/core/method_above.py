"""Methods whose function is in a package that the class itself must not import."""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any


class MethodAbove:
    """A descriptor for a method that is a function of another module, imported only when the method is looked up.

    Data classes must not import the packages that plot and analyse them, since these import the data classes. The
    object is the function's first argument.

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
