"""What every part of a scenario file has in common."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from slidax._errors import DefinitionError, nearest

Numbers = Annotated[float | list[float], Field(union_mode="left_to_right")]
"""One number for all joints, or one per joint."""


class Description(BaseModel):
    """A mapping in a scenario file: immutable, its keys known."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = list(cls.model_fields)
            for key in data:
                if key not in known:
                    hint = nearest(str(key), known)
                    raise PydanticCustomError("unknown_key", "unknown key `{key}`; {hint}", {"key": key, "hint": hint})
        return data

    def require_joints(self, joints: int) -> None:
        """Raises a DefinitionError unless each list in it has one entry per joint; not for lists of other things.

        - `joints`: the number of joints.
        """
        for field, value in self:
            if isinstance(value, list) and len(value) != joints:
                message = f"must be one number or one for each of the {joints} joints; got {len(value)}"
                raise DefinitionError(message, where=field)

    def parameters(self) -> dict[str, Any]:
        """What the described part is made from: the fields that are given, but for the one that names its kind."""
        return self.model_dump(exclude={"kind", "name", "sampled_data"}, exclude_none=True)
