"""Check for optional packages."""

from __future__ import annotations

from importlib.util import find_spec

from slidax._errors import DefinitionError


def require_packages(purpose: str, *packages: str, extra: str = "view") -> None:
    """Raise DefinitionError with the remedy if one of the packages is not installed.

    - `purpose`: the subject of the message.
    - `packages`: import names.
    - `extra`: the extra of slidax that installs them.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise DefinitionError(f"{purpose} needs {' and '.join(missing)}: pip install 'slidax[{extra}]'")
