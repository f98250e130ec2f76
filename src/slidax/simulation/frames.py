"""Columns with units as a data frame of pandas or polars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from slidax._errors import DefinitionError

Kind = Literal["pandas", "polars"]
"""Library of the data frame."""

KINDS = ("pandas", "polars")


def data_frame(columns: Mapping[str, Any], kind: Kind = "pandas", units: Mapping[str, str] | None = None) -> Any:
    """Return a data frame from columns of equal length. pandas keeps the units in `attrs`; polars drops them.

    Raises DefinitionError if the library is another, or is not installed.
    """
    if kind not in KINDS:
        raise DefinitionError(f'a data frame is of "pandas" or of "polars"; got "{kind}"')
    try:
        if kind == "polars":
            import polars

            return polars.DataFrame({name: _flat(values) for name, values in columns.items()})
        import pandas
    except ImportError:
        raise DefinitionError(
            f"a data frame of {kind} needs {kind}, which is not installed: pip install 'slidax[frame]'"
        ) from None
    frame = pandas.DataFrame(dict(columns))
    if units is not None:
        frame.attrs["units"] = dict(units)
    return frame


def _flat(values: Any) -> Any:
    return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else list(values)
