"""Names of parts in files, derived from the names of their classes."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from typing import Any


def kind_of(part: type) -> str:
    """Return the name of a part in files: its class's name in small letters, without the word of its family.

    `FixedTimeReaching` is `fixed_time`, `PrescribedPerformance` is `prescribed_performance`. A class variable `kind`
    takes precedence.
    """
    if own := vars(part).get("kind"):
        return str(own)
    families = [base.__name__.removeprefix("Abstract") for base in part.__mro__[1:] if base.__module__ != "equinox"]
    name = part.__name__
    for family in families:
        if name.endswith(family) and name != family:
            name = name.removesuffix(family)
            break
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def members_of(family: type) -> dict[str, Any]:
    """Return the parts of an abstract class that its package exports, by their kinds."""
    package = import_module(".".join(family.__module__.split(".")[:2]))
    members = {
        kind_of(thing): thing
        for thing in vars(package).values()
        if inspect.isclass(thing) and issubclass(thing, family) and not inspect.isabstract(thing)
    }
    # Sorted, since the order of the exports says nothing.
    return dict(sorted(members.items()))
