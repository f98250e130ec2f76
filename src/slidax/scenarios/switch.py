"""What happens to the rest of a scheme when another one is named."""

from __future__ import annotations

from typing import Any, get_args

from .base import Description
from .schemes import SchemeDescription

CARRIED = ("performance", "overshoot", "bound", "sampled_data")
"""What describes the task, the arm and its sampling, and not the scheme, and so is kept."""

SCHEMES: dict[str, type[Description]] = {
    get_args(model.model_fields["name"].annotation)[0]: model for model in get_args(get_args(SchemeDescription)[0])
}
"""The descriptions by the names of their schemes."""


def switched(scheme: Any, name: Any) -> Any:
    """The scheme of a scenario file with another name.

    Of what the file says, `performance`, `overshoot`, `bound` and `sampled_data` are kept, as far as the new scheme has
    them; all else is dropped, so that it takes the new scheme's defaults. Where the name is the file's own, nothing
    changes.

    - `scheme`: the mapping in the file.
    - `name`: the name to be set; one that is not known is left for the validation to refuse.
    """
    if not isinstance(scheme, dict):
        return {"name": name}
    model = SCHEMES.get(name) if isinstance(name, str) else None
    if model is None or scheme.get("name") == name:
        return {**scheme, "name": name}
    kept = {key: _known(scheme[key], model, key) for key in CARRIED if key in scheme and key in model.model_fields}
    return {"name": name, **kept}


def _known(value: Any, model: type[Description], key: str) -> Any:
    """The value without those of its keys that the new scheme's field does not have."""
    wanted = model.model_fields[key].annotation
    if isinstance(value, dict) and isinstance(wanted, type) and issubclass(wanted, Description):
        return {k: v for k, v in value.items() if k in wanted.model_fields}
    return value
