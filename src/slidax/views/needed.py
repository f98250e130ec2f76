"""The optional packages that draw."""

from __future__ import annotations

from importlib.util import find_spec

from slidax._errors import DefinitionError


def require_packages(purpose: str, *packages: str, extra: str = "view") -> None:
    """Raises a DefinitionError with the remedy if one of the packages is not installed.

    - `purpose`: what they are needed for, the start of the message.
    - `packages`: by the name that is imported.
    - `extra`: of slidax, which brings them.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise DefinitionError(f"{purpose} needs {' and '.join(missing)}: pip install 'slidax[{extra}]'")
