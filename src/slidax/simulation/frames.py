"""Columns with units as a data frame of pandas or polars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from slidax._errors import DefinitionError

Kind = Literal["pandas", "polars"]
"""Which library makes the data frame."""

KINDS = ("pandas", "polars")


def data_frame(columns: Mapping[str, Any], kind: Kind = "pandas", units: Mapping[str, str] | None = None) -> Any:
    """A data frame: of pandas, with the units in its `attrs`, or of polars, which has no place for them.

    - `columns`: by name, all of one length.
    - `kind`: "pandas" or "polars".
    - `units`: of the columns, by name.

    Raises DefinitionError if the library is another, or is not installed.
    """
    if kind not in KINDS:
        raise DefinitionError(f'a data frame is of "pandas" or of "polars"; got "{kind}"')
    try:
        if kind == "polars":
            import polars

            return polars.DataFrame({name: _plain(values) for name, values in columns.items()})
        import pandas
    except ImportError:
        raise DefinitionError(
            f"a data frame of {kind} needs {kind}, which is not installed: pip install 'slidax[frame]'"
        ) from None
    made = pandas.DataFrame(dict(columns))
    if units is not None:
        made.attrs["units"] = dict(units)
    return made


def _plain(values: Any) -> Any:
    """Without a shape of its own, as polars takes it."""
    return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else list(values)
