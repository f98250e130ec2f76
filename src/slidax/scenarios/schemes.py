"""Control schemes in a scenario file: presets by name, with their parts and parameters.

A preset is a control law with default parts, such as a sliding surface, and default values.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

import equinox as eqx
import numpy as np
from jaxtyping import Array
from pydantic import ConfigDict, Field, SerializeAsAny, WrapValidator, create_model, model_validator
from pydantic_core import PydanticCustomError

from slidax.core.errors import DefinitionError
from slidax.core.parameter import parameters_of
from slidax.core.part import kind_of
from slidax.law.controllers import AbstractController, AbstractModelBased
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.linear_controllers import ComputedTorque, JointPID
from slidax.law.presets import (
    Preset,
    PresetPart,
    anftsmc,
    cftsmppc,
    computed_torque,
    ftsmc,
    ftsmppc,
    gravity_pd,
    nftsmc,
    pid,
    sfsmc,
    sfsmppc,
    sliding_mode,
    slotine_li,
    slotine_li_ppc,
    super_twisting,
)
from slidax.law.torque_bounds import UncertaintyBound

from .descriptions import (
    PartDescription,
    build_parts,
    described_field,
    description_of,
    hints_of,
    preset_of,
    type_of,
    union_of,
)
from .own_code import own_class
from .sampled_data import SampledDataDescription

PRESETS: dict[str, Preset] = {
    "anftsmc": anftsmc,
    "cftsmppc": cftsmppc,
    "computed_torque": computed_torque,
    "ftsmc": ftsmc,
    "ftsmppc": ftsmppc,
    "gravity_pd": gravity_pd,
    "nftsmc": nftsmc,
    "pid": pid,
    "sfsmc": sfsmc,
    "sfsmppc": sfsmppc,
    "sliding_mode": sliding_mode,
    "slotine_li": slotine_li,
    "slotine_li_ppc": slotine_li_ppc,
    "super_twisting": super_twisting,
}
"""Schemes that a file can name."""

ENVELOPE = tuple(parameter.name for parameter in parameters_of(PrescribedPerformance))
"""Parameters of an envelope, such as `performance` and `overshoot`, which a file may write in the scheme itself."""

COMPUTED: dict[type[eqx.Module], dict[str, str]] = {
    UncertaintyBound: {
        parameter.name: "the arm, its drives and the stated mismatch" for parameter in parameters_of(UncertaintyBound)
    }
}
"""Parameters that are computed if the file lacks them, by class of their part, each with the source of its value."""


def _for_editors(schema: dict[str, Any], model: type[SchemeDescription]) -> None:
    """Mark parts that the preset completes as optional, and add the envelope's parameters to those of the scheme."""
    for name, part in _parts(model.preset).items():
        known = {**part.values, **COMPUTED.get(part.part, {})}
        missing = [p for p in parameters_of(part.part) if p.required and p.name not in known]
        if not missing or part.part is PrescribedPerformance:
            schema["required"].remove(name)
    if "transformation" in schema["properties"]:
        inside = description_of(PrescribedPerformance).model_fields
        for name in ENVELOPE:
            schema["properties"][name] = {"description": inside[name].description}


class SchemeDescription(PartDescription):
    """The control scheme: a preset law, and the parameters that the file changes."""

    model_config = ConfigDict(json_schema_extra=_for_editors)

    preset: ClassVar[Preset]

    name: Any
    sampled_data: SampledDataDescription | None = None
    """The form of the scheme for a fixed sample time; by default the law as its source prints it."""

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = place_parameters(data)
        for name, part in _parts(cls.preset).items():
            value = data.setdefault(name, {})
            if isinstance(value, dict):
                data[name] = with_preset_values(part, value)
        return data

    @model_validator(mode="after")
    def _gains_are_unique(self) -> SchemeDescription:
        if issubclass(self.part, ComputedTorque) and getattr(self, "horizon", None) is not None:
            both = sorted({"kp", "kd"} & self.model_fields_set)
            if both:
                message = "`horizon` replaces `kp` and `kd`: leave `{gain}` or `horizon` out"
                raise PydanticCustomError("two_gains", message, {"gain": both[0]})
        return self

    def with_bound(self, find: Callable[[], dict[str, float]]) -> SchemeDescription:
        """Return the scheme with a value for each parameter of its uncertainty bound.

        - `find`: returns default values by parameter name, for those that the file lacks.
        """
        bound = getattr(self, "bound", None)
        if not isinstance(bound, PartDescription) or bound.part is not UncertaintyBound:
            return self
        missing = [name for name, value in bound if value is None]
        if not missing:
            return self
        defaults = find()
        update = {name: defaults[name] for name in missing}
        return self.model_copy(update={"bound": bound.model_copy(update=update)})

    def with_limit(self, torque: Array) -> SchemeDescription:
        """Return the scheme; a PID without a limit of its integral part gets the torque limits, if all are finite.

        - `torque`: torque limits of the drives, a number or [n], N m or N.
        """
        limited = issubclass(self.part, JointPID) and getattr(self, "limit", None) is None
        if not limited or not np.isfinite(torque).all():
            return self
        return self.model_copy(update={"limit": np.asarray(torque).tolist()})

    def build(self, **more: Any) -> AbstractController:
        """Build the law in continuous time, in the form of its publication.

        - `more`: `nominal`, the arm that the law knows; nothing for a law without a model.

        Raises DefinitionError, with the path of the field, if a value is invalid.
        """
        skipped = ("name", "sampled_data")
        values = {name: build_parts(name, value) for name, value in self if name not in skipped and value is not None}
        return self.part(**values, **more)


def _parts(preset: Preset | None) -> dict[str, PresetPart]:
    values = preset.values if preset is not None else {}
    return {name: part for name, part in values.items() if isinstance(part, PresetPart)}


def _preset_of(scheme: Mapping[str, Any]) -> Preset | None:
    name = scheme.get("name")
    return PRESETS.get(name) if isinstance(name, str) else None


def with_preset_values(part: PresetPart, value: dict[str, Any]) -> dict[str, Any]:
    """Return the mapping of a part, in which missing values come from the preset.

    A mapping with another kind than the preset's part is returned as it is.

    - `part`: the preset's part.
    - `value`: mapping of the part in the file.
    """
    kind = kind_of(part.part)
    return {"kind": kind, **part.values, **value} if value.get("kind", kind) == kind else value


def place_parameters(scheme: dict[str, Any]) -> dict[str, Any]:
    """Return a scheme's mapping in which each parameter is in the mapping of its part.

    `{"k1": 0.3}` becomes `{"surface": {"k1": 0.3}}` if only the surface of the preset has a k1. Former names of
    parameters are replaced by the current ones.
    """
    preset = _preset_of(scheme)
    if preset is None:
        return scheme
    own = {"name", "sampled_data", *(parameter.name for parameter in parameters_of(preset.law))}
    result: dict[str, Any] = {key: value for key, value in scheme.items() if key in own}
    for key, value in scheme.items():
        owner = owner_of(preset, key)
        if owner is None or key in own:
            result[key] = value
            continue
        part = result.get(owner, {})
        if isinstance(part, dict):
            result[owner] = {**part, key: value}
    envelope = result.get("transformation")
    if isinstance(envelope, dict) and envelope.keys() & set(ENVELOPE):
        result["transformation"] = {"kind": kind_of(PrescribedPerformance), **envelope}
    return result


def with_kinds(scheme: dict[str, Any]) -> dict[str, Any]:
    """Return a scheme's mapping in which each part has a `kind`, by default the preset's.

    - `scheme`: result of `place_parameters`.
    """
    parts = {name: part for name, part in _parts(_preset_of(scheme)).items() if isinstance(scheme.get(name), dict)}
    return {**scheme, **{name: {"kind": kind_of(part.part), **scheme[name]} for name, part in parts.items()}}


def owner_of(preset: Preset, name: str) -> str | None:
    """Return the name of the preset's part that has a parameter, such as `surface`.

    The result is None if the scheme itself has the parameter, or several parts or no part have it.

    - `name`: name of the parameter.
    """
    own = {parameter.name for parameter in parameters_of(preset.law)}
    if name in own:
        return None
    if name in ENVELOPE and "transformation" in own:
        return "transformation"
    owners = preset.owners(name)
    return owners[0] if len(owners) == 1 else None


OF_PLANS = ("horizon", "slopes", "recovery", "calm")
"""Keys of `sampled_data` only for laws that plan over a horizon."""


def switch_scheme(scheme: Any, name: Any) -> Any:
    """Return the mapping `scheme` of a scenario file for another preset.

    The result keeps `sampled_data`, the envelope, and those parameters of the bound that the new preset does not set.
    If the new law does not plan over a horizon, `horizon`, `slopes`, `recovery` and `calm` of `sampled_data` are
    dropped. All other parameters take the new preset's values. A law outside slidax, `module:Class`, keeps only
    `sampled_data` without these four. With the file's own name, nothing changes.

    - `scheme`: mapping of the file.
    - `name`: name of the new preset; an unknown name is refused later, at validation.
    """
    if not isinstance(scheme, dict):
        return {"name": name}
    if scheme.get("name") == name:
        return scheme
    if isinstance(name, str) and ":" in name:
        block = scheme.get("sampled_data")
        if not isinstance(block, dict):
            return {"name": name}
        return {"name": name, "sampled_data": {k: v for k, v in block.items() if k not in OF_PLANS}}
    preset = PRESETS.get(name) if isinstance(name, str) else None
    if preset is None:
        return {**scheme, "name": name}
    old, new = place_parameters(scheme), {"name": name}
    for key in ("transformation", "bound"):
        part, target = old.get(key), _parts(preset).get(key)
        if target is None or not isinstance(part, dict):
            continue
        own = _parts(PRESETS.get(str(scheme.get("name")))).get(key)
        kind = part.get("kind", None if own is None else kind_of(own.part))
        if key == "transformation" and kind != kind_of(target.part):
            continue
        kept = {parameter.name for parameter in parameters_of(target.part)} - set(target.values)
        new[key] = {name: value for name, value in part.items() if name in kept}
    if "sampled_data" in old:
        block, dropped = old["sampled_data"], () if preset.law.plans else OF_PLANS
        is_block = isinstance(block, dict)
        new["sampled_data"] = {k: v for k, v in block.items() if k not in dropped} if is_block else block
    return new


def described_scheme(name: str, preset: Preset) -> type[SchemeDescription]:
    """Return the pydantic model for a block `scheme` of a preset.

    - `name`: the name by which files select the preset.
    """
    fields: dict[str, Any] = {"name": (Literal[name], Field(description="Name of the scheme."))}
    for parameter in parameters_of(preset.law):
        if parameter.name == "nominal":
            continue
        value, hint = preset.values.get(parameter.name), hints_of(preset.law)[parameter.name]
        changes = {}
        if isinstance(hint, type) and issubclass(hint, eqx.Module):
            default = None
            if isinstance(value, PresetPart):
                default = preset_of(value.part, name, value.values, preset.source, COMPUTED.get(value.part, {}))
            annotation = union_of(hint, default=default)
        else:
            annotation = type_of(parameter, hint, preset.law)
            if value is not None:
                changes = {"default": value, "source": preset.source}
            if parameter.default is None:
                annotation = annotation | None
        fields[parameter.name] = (annotation, described_field(parameter, **changes))
    title = preset.title.strip().partition("\n")[0]
    model: type[SchemeDescription] = create_model(f"scheme.{name}", __base__=SchemeDescription, __doc__=title, **fields)
    model.part, model.preset = preset.law, preset
    return model


@functools.cache
def _own_scheme(name: str, law: type[AbstractController]) -> type[SchemeDescription]:
    return described_scheme(name, Preset(law, (law.__doc__ or name).strip()))


def _validated(value: Any, others: Callable[[Any], Any], info: Any) -> Any:
    """Validate a scheme; the name `module:Class` refers to a law outside slidax."""
    name = value.get("name") if isinstance(value, dict) else None
    if not isinstance(name, str) or ":" not in name:
        return value if isinstance(value, SchemeDescription) else others(value)
    try:
        law = own_class(name, AbstractModelBased, (info.context or {}).get("folder", ""))
    except DefinitionError as error:
        raise PydanticCustomError("own_law", "{message}", {"message": error.message}) from None
    return _own_scheme(name, law).model_validate(value, context=info.context)


SCHEMES = {name: described_scheme(name, preset) for name, preset in PRESETS.items()}
"""Pydantic models of the schemes by name."""

if TYPE_CHECKING:
    AnyScheme = SchemeDescription
else:
    OPTIONS = (Field(discriminator="name"), SerializeAsAny(), WrapValidator(_validated))
    AnyScheme = Annotated[Union[tuple(SCHEMES.values())], *OPTIONS]  # noqa: UP007
