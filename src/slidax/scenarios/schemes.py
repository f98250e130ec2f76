"""Control schemes in a scenario file: each preset by its name, with its parts and numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Union

import equinox as eqx
import numpy as np
from jaxtyping import Array
from pydantic import ConfigDict, Field, create_model, model_validator

from slidax.controllers import (
    AbstractController,
    Given,
    JointPID,
    Preset,
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
from slidax.parts import kind_of, parameters_of
from slidax.reaching import UncertaintyBound
from slidax.transformations import PrescribedPerformance

from .base import described
from .derived import PartDescription, built, description_of, hints_of, preset_of, type_of, union_of
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
"""The schemes that a file can name."""

ENVELOPE = tuple(one.name for one in parameters_of(PrescribedPerformance))
"""What may stand in a scheme itself: `performance` and `overshoot` make an envelope."""

RENAMED = {
    "inertia_min": "inverse_inertia_min",
    "inertia_max": "inverse_inertia_max",
    **{"constant": "b0", "position": "b1", "velocity": "b2"},
}
"""Earlier names of a bound's numbers, which files may still have."""


FOUND: dict[type[eqx.Module], dict[str, str]] = {
    UncertaintyBound: dict.fromkeys(
        (one.name for one in parameters_of(UncertaintyBound)), "the arm, its drives and the stated mismatch"
    )
}
"""Numbers of parts that a scenario finds by itself where a file does not give them, and from what."""


def _for_editors(schema: dict[str, Any], model: type[SchemeDescription]) -> None:
    """What a file may leave out, since the preset has it, and what may stand in the scheme itself."""
    for name, given in model.preset.values.items():
        if isinstance(given, Given):
            known = {**given.values, **FOUND.get(given.part, {})}
            missing = [one for one in parameters_of(given.part) if one.required and one.name not in known]
            if not missing or given.part is PrescribedPerformance:
                schema["required"].remove(name)
    if "transformation" in schema["properties"]:
        inside = description_of(PrescribedPerformance).model_fields
        for name in ENVELOPE:
            schema["properties"][name] = {"description": inside[name].description}


class SchemeDescription(PartDescription):
    """The control scheme, with what differs from its preset."""

    model_config = ConfigDict(json_schema_extra=_for_editors)

    preset: ClassVar[Preset]

    name: Any
    sampled_data: SampledDataDescription | None = None
    """The scheme as steps for the arm's own rate; the law as it is printed if not given."""

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        data = placed(data)
        for name, given in cls.preset.values.items():
            value = data.setdefault(name, {}) if isinstance(given, Given) else None
            if isinstance(given, Given) and isinstance(value, dict):
                data[name] = filled(given, value)
        return data

    def with_bound(self, find: Callable[[], dict[str, float]]) -> SchemeDescription:
        """The scheme with every number of its bound.

        - `find`: what the numbers are that the file does not give.
        """
        bound = getattr(self, "bound", None)
        if not isinstance(bound, PartDescription) or bound.part is not UncertaintyBound:
            return self
        missing = [name for name, value in bound if value is None]
        if not missing:
            return self
        found = find()
        update = {name: found[name] for name in missing}
        return self.model_copy(update={"bound": bound.model_copy(update=update)})

    def with_limit(self, torque: Array) -> SchemeDescription:
        """The scheme with the torque at which its integral stops.

        - `torque`: the drives' limits, where the file does not say another, one number or [n], N m or N.
        """
        limited = issubclass(self.part, JointPID) and getattr(self, "limit", None) is None
        if not limited or not np.isfinite(torque).all():
            return self
        return self.model_copy(update={"limit": np.asarray(torque).tolist()})

    def build(self, **more: Any) -> AbstractController:
        """The controller as it is printed.

        - `more`: `nominal`, the robot as the law knows it.

        Raises DefinitionError, with the path of the field, if it is invalid.
        """
        skipped = ("name", "sampled_data")
        values = {name: built(name, value) for name, value in self if name not in skipped and value is not None}
        return self.part(**values, **more)


def filled(given: Given, value: dict[str, Any]) -> dict[str, Any]:
    """A part of a scheme with its kind and its preset's numbers, where it is of the preset's kind.

    - `given`: the preset's.
    - `value`: as it stands in a file.
    """
    kind = kind_of(given.part)
    return {"kind": kind, **given.values, **value} if value.get("kind", kind) == kind else value


def placed(scheme: dict[str, Any]) -> dict[str, Any]:
    """A scheme with each number under the part that has it, by its present name.

    - `scheme`: as it stands in a file.
    """
    preset = PRESETS.get(scheme.get("name", "")) if isinstance(scheme.get("name"), str) else None
    if preset is None:
        return scheme
    own = {"name", "sampled_data", *(one.name for one in parameters_of(preset.law))}
    found: dict[str, Any] = {key: value for key, value in scheme.items() if key in own}
    for key, value in scheme.items():
        owner = owner_of(preset, key)
        if owner is None or key in own:
            found[key] = value
            continue
        part = found.get(owner, {})
        if isinstance(part, dict):
            found[owner] = {**part, key: value}
    envelope = found.get("transformation")
    if isinstance(envelope, dict) and envelope.keys() & set(ENVELOPE):
        found["transformation"] = {"kind": kind_of(PrescribedPerformance), **envelope}
    if isinstance(found.get("bound"), dict):
        found["bound"] = {RENAMED.get(key, key): value for key, value in found["bound"].items()}
    return found


def with_kinds(scheme: dict[str, Any]) -> dict[str, Any]:
    """A scheme whose parts say their kinds, also where it is the preset's.

    - `scheme`: as `placed` returns it.
    """
    preset = PRESETS.get(scheme.get("name", "")) if isinstance(scheme.get("name"), str) else None
    given = {name: one for name, one in (preset.values if preset else {}).items() if isinstance(one, Given)}
    kinds = {name: {"kind": kind_of(one.part)} for name, one in given.items() if isinstance(scheme.get(name), dict)}
    return {**scheme, **{name: {**kind, **scheme[name]} for name, kind in kinds.items()}}


def renamed(path: list[str]) -> list[str]:
    """A path with the present names of a bound's numbers.

    - `path`: its parts.
    """
    return [*path[:-1], RENAMED.get(path[-1], path[-1])] if path[:2] == ["scheme", "bound"] else path


def owner_of(preset: Preset, name: str) -> str | None:
    """The part of a scheme that has a number which stands in the scheme itself; None if that is the scheme's own.

    - `preset`: of the scheme.
    - `name`: of the number.
    """
    own = {one.name for one in parameters_of(preset.law)}
    if name in own:
        return None
    if name in ENVELOPE and "transformation" in own:
        return "transformation"
    owners = preset.owners(name)
    return owners[0] if len(owners) == 1 else None


OF_PLANS = ("horizon", "slopes", "recovery")
"""What `sampled_data` says for laws that plan over a horizon alone."""


def switched(scheme: Any, name: Any) -> Any:
    """The scheme of a scenario file with another name.

    What describes the task, the arm and its sampling is kept, as far as the new scheme has it: the envelope, the bound
    but for what the new scheme has a number of its own for, and of `sampled_data` the estimator, with the rest if the
    new scheme plans over a horizon. All else is dropped, so that it takes the new scheme's numbers. Where the name is
    the file's own, nothing changes.

    - `scheme`: the mapping in the file.
    - `name`: the name to be set; one that is not known is left for the validation to refuse.
    """
    if not isinstance(scheme, dict):
        return {"name": name}
    preset = PRESETS.get(name) if isinstance(name, str) else None
    if preset is None or scheme.get("name") == name:
        return {**scheme, "name": name}
    old, new = placed(scheme), {"name": name}
    for key in ("transformation", "bound"):
        part, given = old.get(key), preset.values.get(key)
        if not isinstance(given, Given) or not isinstance(part, dict):
            continue
        had = getattr(PRESETS.get(str(scheme.get("name"))), "given", {}).get(key)
        kind = part.get("kind", kind_of(had.part) if isinstance(had, Given) else None)
        if key == "transformation" and kind != kind_of(given.part):
            continue
        wanted = {one.name for one in parameters_of(given.part)} - set(given.values)
        new[key] = {name: value for name, value in part.items() if name in wanted}
    if "sampled_data" in old:
        block, dropped = old["sampled_data"], () if preset.law.plans else OF_PLANS
        is_block = isinstance(block, dict)
        new["sampled_data"] = {k: v for k, v in block.items() if k not in dropped} if is_block else block
    return new


def described_scheme(name: str, preset: Preset) -> type[SchemeDescription]:
    """The description of a scheme.

    - `name`: what it is called in files.
    - `preset`: its law, parts and numbers.
    """
    fields: dict[str, Any] = {"name": (Literal[name], Field(description="Which scheme it is."))}
    for one in parameters_of(preset.law):
        if one.name == "nominal":
            continue
        given, hint = preset.values.get(one.name), hints_of(preset.law)[one.name]
        if isinstance(hint, type) and issubclass(hint, eqx.Module):
            default = None
            if isinstance(given, Given):
                default = preset_of(given.part, name, given.values, preset.source, FOUND.get(given.part, {}))
            annotation, has = union_of(hint, default=default), {}
        else:
            annotation = type_of(one, hint, preset.law)
            has = {"default": given, "source": preset.source} if given is not None else {}
            if one.default is None:
                annotation = annotation | None
        fields[one.name] = (annotation, described(one, **has))
    title = preset.title.strip().partition("\n")[0]
    model: type[SchemeDescription] = create_model(f"scheme.{name}", __base__=SchemeDescription, __doc__=title, **fields)
    model.part, model.preset = preset.law, preset
    return model


SCHEMES = {name: described_scheme(name, preset) for name, preset in PRESETS.items()}
"""The descriptions of the schemes by their names."""

if TYPE_CHECKING:
    AnyScheme = SchemeDescription
else:
    AnyScheme = Annotated[Union[tuple(SCHEMES.values())], Field(discriminator="name")]  # noqa: UP007
