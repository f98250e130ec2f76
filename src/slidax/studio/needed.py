"""The packages that serve."""

from __future__ import annotations

from importlib.util import find_spec

from slidax._errors import DefinitionError


def require_studio() -> None:
    """Raises a DefinitionError with the remedy if what serves the page is not installed."""
    missing = [package for package in ("starlette", "uvicorn") if find_spec(package) is None]
    if missing:
        raise DefinitionError(f"the studio needs {' and '.join(missing)}: pip install 'slidax[studio]'")
