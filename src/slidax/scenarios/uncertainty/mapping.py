"""Block `uncertainty` of a scenario: sets by path, some of them from a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from slidax._errors import DefinitionError

from ..yaml_text import read_yaml_file
from .sets import AbstractSet, AnySet

FILE = "file"
"""Key for a file with a mapping `uncertainty`, as from `slidax identify`."""


def _with_file(data: Any, info: Any) -> Any:
    if not isinstance(data, dict) or FILE not in data:
        return data
    path = Path((info.context or {}).get("folder", "")) / str(data[FILE])
    try:
        content = read_yaml_file(path)
    except DefinitionError as error:
        raise _refused(str(error)) from None
    sets = content.get("uncertainty") if isinstance(content, dict) else None
    if not isinstance(sets, dict):
        raise _refused(f"the file `{path}` has no mapping `uncertainty`, as `slidax identify` writes one")
    return sets | {path: values for path, values in data.items() if path != FILE}


def _refused(message: str) -> PydanticCustomError:
    return PydanticCustomError("unknown_key", "{message}", {"message": message})


if TYPE_CHECKING:
    Uncertainty = dict[str, AbstractSet]
else:
    Uncertainty = Annotated[dict[str, AnySet], BeforeValidator(_with_file)]
"""Sets by path; `file` names a file with more sets."""
