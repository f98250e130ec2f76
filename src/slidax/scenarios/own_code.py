"""Import of a user's classes to which a scenario file refers; only if the user allows it."""

from __future__ import annotations

import inspect
import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

from slidax.core.errors import DefinitionError, plain_name
from slidax.core.part import AbstractPart

VARIABLE = "SLIDAX_ALLOW_CODE"
"""Environment variable that allows such imports; the processes of a study inherit it."""


def allow_code() -> None:
    """Allow scenario files to refer to your own classes, such as `kind: my_module:MySurface`.

    Importing a module runs its code: allow it only for files that you trust. `slidax --allow-code` does the same for a
    command.
    """
    os.environ[VARIABLE] = "1"


def own_class(name: str, family: type, folder: str | Path) -> type[AbstractPart]:
    """Import and return a user's class of a part.

    - `name`: the class as a file refers to it, `module:Class`.
    - `family`: abstract class from which it must be derived.
    - `folder`: folder of the file, where the module is searched first, then in the current folder.

    Raises DefinitionError if this is not allowed, the import fails, or the class is of another family.
    """
    shown = plain_name(name)
    if os.environ.get(VARIABLE) != "1":
        raise DefinitionError(
            f"`{shown}` names code of your own, which is imported only if you allow it: `slidax --allow-code COMMAND`, "
            "or `slidax.scenarios.allow_code()` in Python"
        )
    module, _, attribute = name.partition(":")
    places = [str(Path(place).resolve()) for place in (folder, Path())]
    sys.path[:0] = places
    try:
        part = getattr(import_module(module), attribute)
    except Exception as error:
        # Any exception is possible, since the module's own code runs.
        own = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename.startswith(tuple(places))]
        line = f"line {own[-1].lineno} of {own[-1].filename}: " if own else ""
        kind = "" if isinstance(error, ImportError | AttributeError) else f"{type(error).__name__}: "
        raise DefinitionError(
            f"cannot import `{shown}` from {' or '.join(dict.fromkeys(places))}: {line}{kind}{error}"
        ) from None
    finally:
        for place in places:
            sys.path.remove(place)
    if not (isinstance(part, type) and issubclass(part, family) and issubclass(part, AbstractPart)):
        raise DefinitionError(f"`{shown}` must be a class derived from `{family.__name__}`")
    if inspect.isabstract(part):
        raise DefinitionError(
            f"`{shown}` must define {' and '.join(f'`{name}`' for name in sorted(part.__abstractmethods__))}"
        )
    return part
