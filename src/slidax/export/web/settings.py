"""Settings of a page. A setting is one arm with one scheme: its programs, tunable values, C files and certificates.

A scheme is a control law. The manifest is the JSON data of a page. A variant is a setting's scenario with one
combination of its choices.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from slidax.certify.certify import CERTIFICATES, certify
from slidax.core.errors import DefinitionError, is_traced, nearest_word, plain_name
from slidax.scenarios.family import UNTRACEABLE, Family, Space, Templates
from slidax.scenarios.load import validate_text
from slidax.scenarios.scenario import Scenario, ScenarioDescription
from slidax.scenarios.schemes import PRESETS

from ..c_project import FILES, STEP, project
from ..c_structures import render
from .loop_program import LoopProgram, Variant, loop_program, pack_bytes
from .tunables import Tunable, tunables_of, value_at

TEMPLATES = (*STEP, "example.c.j2")
"""Templates of the C files on the page; without the tests, whose golden samples are large."""


def c_files(family: Family, templates: Templates, tunables: Sequence[Tunable]) -> dict[str, Any]:
    """Return a setting's manifest entries `c_files` and `c_parameters`; both None if the law cannot be exported.

    In the C files, marks such as `@{k1[0]}` replace the defaults of the tunable values; the page inserts the current
    values. `c_parameters` lists the marks of each value.

    - `family`, `templates`: the setting's scenario as described, and as built.
    - `tunables`: the tunable values.
    """
    try:
        exported = project(templates.built, name="law", with_golden=False)
    except DefinitionError:
        return {"c_files": None, "c_parameters": None}
    files = {
        FILES[name].format(prefix=exported.prefix, name=exported.name): render(name, {"x": exported})
        for name in TEMPLATES
    }
    source, header = f"{exported.prefix}.c", f"{exported.prefix}.h"
    values = []
    for tunable in tunables:
        name = _member(tunable.path)
        # A long array spans several lines.
        match = name and re.search(rf"^( +\.{name} = )({{[^{{}}]*}}|[^{{}},\n]+),$", files[source], re.MULTILINE)
        if not name or not match or not _alone(family, templates, tunable):
            continue
        marks = [f"@{{{name}[{k}]}}" for k in range(match.group(2).count(",") + 1)]
        text = marks[0] if not match.group(2).startswith("{") else "{" + ", ".join(marks) + "}"
        files[source] = files[source].replace(match.group(0), f"{match.group(1)}{text},")
        files[header] = _without_default(files[header], name, f"as {exported.prefix}_parameters_default says")
        values.append({"path": tunable.path, "marks": marks})
    whole = pack_bytes(json.dumps(files).encode())
    return {"c_files": whole, "c_parameters": {"file": source, "values": values}}


def _member(path: str) -> str | None:
    """Return the name of a tunable value in C; None if it is not a parameter of the law."""
    block, _, rest = path.partition(".")
    if path == "actuator.rate" or path == "actuator.torque":
        return f"limits_{rest}"
    return rest.removeprefix("sampled_data.").replace(".", "_") if block == "scheme" else None


def _without_default(header: str, name: str, words: str) -> str:
    """Return a header with `words` in place of a member's default, since the page may change the default."""
    return re.sub(
        rf"(\b{name}(?:\[\w+\])?; +/\* )[^:*]*?(?=:| \*/)", lambda match: f"{match[1]}{words}", header, count=1
    )


def _alone(family: Family, templates: Templates, tunable: Tunable) -> bool:
    """True if exactly one array of the law depends on a tunable value, so that this array determines the value."""
    family_of_one = Family(family.base, Space({}, {}), Space({}, {tunable.path: None}))  # type: ignore[dict-item]
    moved: list[bool] = []

    def probe(value: Array) -> int:
        with jax.ensure_compile_time_eval():
            controller = family_of_one.parts(templates, {tunable.path: value})[1]
        moved[:] = [is_traced(leaf) for leaf in jax.tree.leaves(eqx.filter(controller, eqx.is_array))]
        return 0

    try:
        jax.eval_shape(probe, jax.ShapeDtypeStruct(np.shape(tunable.defaults), float))
    except UNTRACEABLE:
        return False
    return sum(moved) == 1


def certificates_of(scenario: Scenario, paths: Sequence[str]) -> list[dict[str, Any]]:
    """Return the verdicts of all certificates on a scenario, as JSON data, without running simulations.

    - `paths`: paths of the tunable values, as in `--set`; each verdict lists those on which it may depend.
    """
    lights = []
    for certificate, verdict in zip(CERTIFICATES, certify(scenario, runs=0), strict=True):
        data = verdict.as_json()
        lights.append(
            {
                "certificate": certificate.name,
                "title": verdict.title,
                "holds": verdict.holds,
                "since": data["since"],
                "grade": verdict.grade,
                "statement": verdict.statement,
                "margin": data["margin"],
                "reads": [path for path in paths if certificate.may_read(path)],
            }
        )
    return lights


PlacedVariant = tuple[tuple[int, ...], Variant]
"""A variant, and before it the index of its value for each choice of the setting."""


@dataclass(frozen=True)
class ProgramChoice:
    """A quantity for which the page offers a few values, and no slider, since each value may need another program.

    - `path`: path in the scenario, as in `--set`.
    - `title`, `unit`: texts on the page.
    - `values`: the values, with the scenario's own among them.
    """

    path: str
    title: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class PageSetting:
    """A scenario that a page can show: one arm with one scheme.

    - `description`: the scenario.
    - `arm`, `scheme`: identifiers of arm and scheme in the manifest.
    - `title`: title of the scheme.
    - `kind`: "ours" (the sampled-data law), "printed" (the law as printed in the paper) or "rival" (another law).
    - `choices`: quantities of which the page offers a few values.
    - `note`: a line next to the title.
    """

    description: ScenarioDescription
    arm: str
    scheme: str
    title: str
    kind: str = "ours"
    choices: Sequence[ProgramChoice] = ()
    note: str = ""

    def build(self) -> BuiltSetting:
        """Build the setting's programs, and determine its tunable values.

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
        return BuiltSetting(self, base, templates, tunables, programs_of)

    def _family(self, changes: Mapping[str, Any]) -> Family:
        data = self.description.model_dump(exclude_unset=True)
        described = validate_text(data, dict(changes), form=type(self.description))
        return Family(described.model_copy(update={"robot": described.robot.resolved()}), Space({}, {}), Space({}, {}))


@dataclass(frozen=True)
class BuiltSetting:
    """A setting with its programs.

    - `family`, `templates`: the setting's scenario as described, and as built.
    - `tunables`: values that are inputs of the programs, so that they can change without compiling again.
    - `programs`: pairs of the variants that share a program, and this program.
    """

    setting: PageSetting
    family: Family
    templates: Templates
    tunables: Sequence[Tunable]
    programs: Sequence[tuple[Sequence[PlacedVariant], LoopProgram]]

    def entry(self) -> dict[str, Any]:
        """Return the setting's entry in the manifest, without C files and certificates."""
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
                "constants": pack_bytes(np.concatenate([*defaults, besides]).astype("<f8").tobytes()),
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
        """Return the setting's remaining manifest entries: the law in C, and the certificates (none for a rival)."""
        paths = [*(choice.path for choice in self.setting.choices), *(tunable.path for tunable in self.tunables)]
        certified = [] if self.setting.kind == "rival" else certificates_of(self.templates.built, paths)
        return {**c_files(self.family, self.templates, self.tunables), "certificates": certified}


def _choice(choice: ProgramChoice, described: ScenarioDescription) -> dict[str, Any]:
    own = value_at(described, choice.path.split("."))
    return asdict(choice) | {"values": list(choice.values), "default": choice.values.index(own)}


def _varying(family: Family, templates: Templates, tunables: Sequence[Tunable]) -> list[Tunable]:
    """Return those tunable values that are inputs of one compiled loop: they do not change the compiled code."""
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


def _alike(variants: Sequence[PlacedVariant]) -> list[list[PlacedVariant]]:
    """Group the variants by their form, so that those in a group can share a program."""
    groups: list[list[PlacedVariant]] = []
    for variant in variants:
        group = next((group for group in groups if group[0][1].form == variant[1].form), None)
        groups.append([variant]) if group is None else group.append(variant)
    return groups


TITLES = {
    "cftsmppc": "CFTSMPPC",
    "ftsmppc": "FTSMPPC",
    "ftsmc": "FTSMC",
    "sfsmc": "SFSMC",
    "sfsmppc": "SFSMPPC",
    "computed_torque": "Computed torque + PD",
    "slotine_li": "Slotine-Li",
    "super_twisting": "Super-twisting",
    "pid": "PID",
}
"""Titles of schemes; the other schemes' titles are their names."""

PRINTED = "printed"
"""Name among the schemes to compare that stands for the law as printed in the paper."""

LAYER = 0.05
"""Boundary layer of the printed law [rad/s]; without one the law chatters at a robot's sampling rate."""

OURS = "Sampled-data form, with its own envelope"

WITH = "With the same estimator, adaptation, prediction and limits"

JUDGED = "; it has no envelope, and is judged by the envelope of our law"


def title_of(scheme: str) -> str:
    """Return a scheme's title on a page."""
    return TITLES.get(scheme, scheme.replace("_", " ").capitalize())


def settings_of(
    description: ScenarioDescription,
    arm: str,
    compared: Sequence[str] = (),
    gains: Mapping[str, Mapping[str, float]] = {},
    choices: Sequence[ProgramChoice] = (),
) -> list[PageSetting]:
    """Return the settings for a scenario's own law, and for the laws to compare.

    - `arm`: identifier of the arm in the manifest.
    - `compared`: names of schemes, and `printed` for the law as printed in the paper.
    - `gains`: gains of the compared schemes, by scheme and gain; by default those of the scheme.
    - `choices`: quantities of which the page offers a few values.

    Raises DefinitionError if a scheme does not exist or has parameters without defaults.
    """
    own = description.scheme.name
    sampled = description.scheme.sampled_data is not None
    kind = "ours" if sampled else "printed"
    settings = [PageSetting(description, arm, own, title_of(own), kind, choices, OURS if _draws(description) else "")]
    for name in compared:
        if name == PRINTED:
            if sampled:
                settings.append(_printed(description, arm, choices))
        elif name != own:
            settings.append(_rival(description, arm, name, gains.get(name, {}), choices))
    return settings


def _draws(description: ScenarioDescription) -> bool:
    """True if the law is in sampled-data form and has an envelope."""
    transformation = getattr(description.scheme, "transformation", None)
    return description.scheme.sampled_data is not None and hasattr(transformation, "performance")


def _printed(description: ScenarioDescription, arm: str, choices: Sequence[ProgramChoice]) -> PageSetting:
    own = description.scheme.name
    changes: dict[str, Any] = {"scheme.sampled_data": None, "simulation.outside": "raise"}
    note = "As printed: no estimator, no prediction, no limits known to it"
    reaching = getattr(description.scheme, "reaching", None)
    if getattr(reaching, "layer", None) == 0.0:
        changes["scheme.reaching.layer"] = LAYER
        note += f"; with a layer of {LAYER:g}, as without one it chatters at once"
    return PageSetting(_with(description, changes), arm, f"{own}-printed", f"{title_of(own)}, as printed", "printed",
                   choices, note)  # fmt: skip


def _rival(
    description: ScenarioDescription, arm: str, name: str, gains: Mapping[str, float], choices: Sequence[ProgramChoice]
) -> PageSetting:
    if name not in PRESETS:
        raise DefinitionError(f"scheme `{plain_name(name)}` does not exist; {nearest_word(name, [*PRESETS, PRINTED])}")
    changes: dict[str, Any] = {"scheme.name": name, **{f"scheme.{gain}": value for gain, value in gains.items()}}
    envelope: Any = getattr(description.scheme, "transformation", None)
    if description.tolerance is None and hasattr(envelope, "performance"):
        # A law without an envelope is judged by the envelope of the scenario's own law.
        changes["tolerance"] = {
            key: value for key, value in envelope.model_dump(exclude_unset=True).items() if key != "kind"
        }
    rival = _with(description, changes)
    note = WITH if description.scheme.sampled_data is not None else ""
    if note and "tolerance" in changes and not _draws(rival):
        note += JUDGED
    return PageSetting(rival, arm, name, title_of(name), "rival", choices, note)


def _with(description: ScenarioDescription, changes: dict[str, Any]) -> ScenarioDescription:
    return validate_text(description.model_dump(exclude_unset=True), changes, form=type(description))
