"""The block `uncertainty` of a scenario: sets by path, some of them from a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from slidax._errors import DefinitionError

from ..yaml_text import read_yaml_file
from .sets import AbstractSet, AnySet

FILE = "file"
"""The key that names a file with a mapping `uncertainty`, as `slidax identify` writes one."""


def _with_file(data: Any, info: Any) -> Any:
    if not isinstance(data, dict) or FILE not in data:
        return data
    path = Path((info.context or {}).get("folder", "")) / str(data[FILE])
    try:
        given = read_yaml_file(path)
    except DefinitionError as error:
        raise _refused(str(error)) from None
    found = given.get("uncertainty") if isinstance(given, dict) else None
    if not isinstance(found, dict):
        raise _refused(f"the file `{path}` has no mapping `uncertainty`, as `slidax identify` writes one")
    return found | {path: one for path, one in data.items() if path != FILE}


def _refused(message: str) -> PydanticCustomError:
    return PydanticCustomError("unknown_key", "{message}", {"message": message})


if TYPE_CHECKING:
    Uncertainty = dict[str, AbstractSet]
else:
    Uncertainty = Annotated[dict[str, AnySet], BeforeValidator(_with_file)]
"""Sets by path; `file` names a file with more of them."""
