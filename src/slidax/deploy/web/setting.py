"""One arm under one scheme on a page: its programs, tunables and certificates."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from slidax.scenarios import ScenarioDescription
from slidax.scenarios.family import UNTRACEABLE, Family, Templates
from slidax.scenarios.load import validated
from slidax.scenarios.uncertainty import Space

from .c_files import c_files
from .certified import certificates_of
from .knob import Tunable, tunables_of
from .loop_program import LoopProgram, Variant, loop_program, packed


@dataclass(frozen=True)
class Choice:
    """A quantity that needs a program of its own for each value.

    - `path`: as in `--set`.
    - `values`: including the scenario's own.
    """

    path: str
    title: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Setting:
    """A scenario for a page.

    - `arm`, `scheme`: labels of both in the playground.
    - `title`: of the scheme.
    - `kind`: "ours", "printed" or "rival".
    - `note`: a line next to its title.
    - `rate`: compute `loop_rate` for any number of joints, which may take minutes.
    """

    description: ScenarioDescription
    arm: str
    scheme: str
    title: str
    kind: str = "ours"
    choices: Sequence[Choice] = ()
    note: str = ""
    rate: bool = False

    def build(self) -> Made:
        """Build its programs and tunables.

        Raises DefinitionError if one of its variants is invalid or cannot run in a page.
        """
        base = self._family({})
        templates = base.templates({})
        joints = templates.built.plant.robot.joints
        chosen = {choice.path for choice in self.choices}
        possible = [tunable for tunable in tunables_of(base.base, joints) if tunable.path not in chosen]
        tunables = _varying(base, templates, possible)
        own = {tunable.path: tunable.defaults for tunable in tunables}
        variants = []
        for at in itertools.product(*(range(len(choice.values)) for choice in self.choices)):
            changes = {choice.path: choice.values[k] for choice, k in zip(self.choices, at, strict=True)}
            family = self._family(changes)
            family = Family(family.base, Space({}, {}), Space({}, dict.fromkeys(own)))  # type: ignore[arg-type]
            variants.append((at, Variant(family, family.templates({}), own)))
        programs_of = []
        for group in _alike(variants):
            shared = loop_program([variant for _, variant in group])
            programs = (
                [(group, shared)] if shared is not None else [([pair], loop_program([pair[1]])) for pair in group]
            )
            programs_of += [(group, program) for group, program in programs if program is not None]
        return Made(self, base, templates, tunables, programs_of)

    def _family(self, changes: Mapping[str, Any]) -> Family:
        data = self.description.model_dump(exclude_unset=True)
        described = validated(data, dict(changes), form=type(self.description))
        return Family(described.model_copy(update={"robot": described.robot.resolved()}), Space({}, {}), Space({}, {}))


@dataclass(frozen=True)
class Made:
    """A setting with its programs.

    - `family`, `templates`: its scenario, and that built.
    - `tunables`: variable within a program.
    - `programs`: each with its variants.
    """

    setting: Setting
    family: Family
    templates: Templates
    tunables: Sequence[Tunable]
    programs: Sequence[tuple[Sequence[tuple[tuple[int, ...], Variant]], LoopProgram]]

    def entry(self) -> dict[str, Any]:
        """The setting's entry in a playground."""
        setting, described = self.setting, self.family.base
        choices = [_choice(choice, described) for choice in setting.choices]
        tunables, start = [], 0
        for tunable in self.tunables:
            tunables.append(tunable.entry(start))
            start += int(np.prod(tunable.shape, dtype=int))
        defaults = [tunable.defaults.ravel() for tunable in self.tunables]
        variants = [
            {
                "at": list(at),
                "program": program.entry["id"],
                "constants": packed(np.concatenate([*defaults, besides]).astype("<f8").tobytes()),
            }
            for group, program in self.programs
            for (at, _), besides in zip(group, program.constants, strict=True)
        ]
        own = [choice["default"] for choice in choices]
        return {
            "arm": setting.arm,
            "scheme": setting.scheme,
            "title": setting.title,
            "kind": setting.kind,
            "printed": setting.kind == "printed",
            "note": setting.note,
            "choices": choices,
            "variants": sorted(variants, key=lambda variant: variant["at"]),
            "tunables": tunables,
            "constants": next(variant["constants"] for variant in variants if variant["at"] == own),
            "scenario": described.model_dump(mode="json", exclude_unset=True),
        }

    def beside(self) -> dict[str, Any]:
        """The law in C, and the certificates unless it is a rival."""
        paths = [*(choice.path for choice in self.setting.choices), *(tunable.path for tunable in self.tunables)]
        certified = (
            [] if self.setting.kind == "rival" else certificates_of(self.templates.built, paths, self.setting.rate)
        )
        return {**c_files(self.family, self.templates, self.tunables), "certificates": certified}


def _choice(choice: Choice, described: ScenarioDescription) -> dict[str, Any]:
    own = _at(described, choice.path)
    return {
        "path": choice.path,
        "title": choice.title,
        "unit": choice.unit,
        "values": list(choice.values),
        "default": choice.values.index(own),
    }


def _at(place: Any, path: str) -> Any:
    for name in path.split("."):
        place = place[int(name)] if isinstance(place, tuple | list) else getattr(place, name)
    return place


def _varying(family: Family, templates: Templates, tunables: Sequence[Tunable]) -> list[Tunable]:
    """Tunables that can vary within one compiled loop."""
    if not tunables:
        return []
    some = {tunable.path: np.stack([tunable.defaults] * 2) for tunable in tunables}
    varied = Family(family.base, Space({}, {}), Space({}, dict.fromkeys(some)))  # type: ignore[arg-type]
    known: Any = jax.tree.structure((family.parts(templates, {}),))

    def probe(values: Any) -> int:
        if jax.tree.structure((varied.parts(templates, values),)) != known:
            raise TypeError("the compiled code depends on it")
        return 0

    try:
        jax.vmap(probe)(some)
        return list(tunables)
    except UNTRACEABLE:
        if len(tunables) == 1:
            return []
    half = len(tunables) // 2
    return _varying(family, templates, tunables[:half]) + _varying(family, templates, tunables[half:])


def _alike(
    variants: Sequence[tuple[tuple[int, ...], Variant]],
) -> list[list[tuple[tuple[int, ...], Variant]]]:
    """Group variants of one form."""
    groups: list[list[tuple[tuple[int, ...], Variant]]] = []
    for variant in variants:
        for group in groups:
            if group[0][1].form == variant[1].form:
                group.append(variant)
                break
        else:
            groups.append([variant])
    return groups
