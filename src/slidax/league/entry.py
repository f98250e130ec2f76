"""Entries of the benchmark: a scheme in one of its forms."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from slidax._errors import DefinitionError, nearest, plain
from slidax.controllers import AbstractController, Preset
from slidax.parts import parameters_of
from slidax.scenarios.description import ScenarioDescription
from slidax.scenarios.entered import with_scheme
from slidax.scenarios.load import validated
from slidax.scenarios.schemes import PRESETS

from .gains import Gains, gains_of
from .task import BenchmarkTask

Form = Literal["sampled-data", "printed"]
FORMS: tuple[Form, ...] = ("sampled-data", "printed")
"""With the common estimator, learning, prediction and limits, or as printed in the scheme's source."""

COMMON_NAMES = {("computed_torque", "sampled-data"): "computed_torque + disturbance observer"}
"""Better known names of a scheme in a form."""


@dataclass(frozen=True)
class BenchmarkEntry:
    """A `scheme` in a `form`.

    - `scheme`: a name of `slidax list schemes`, or `package.module:Name` of a preset or a controller class.
    """

    scheme: str
    form: Form

    @property
    def name(self) -> str:
        """The name in tables."""
        return COMMON_NAMES.get((self.scheme, self.form), self.scheme.rpartition(":")[2])

    @property
    def file(self) -> str:
        """The stem of its files."""
        return f"{self.scheme.replace(':', '.')}--{self.form}"

    @cached_property
    def preset(self) -> Preset:
        """The law with its parts.

        Raises DefinitionError if the scheme does not exist.
        """
        if ":" not in self.scheme:
            if self.scheme not in PRESETS:
                raise DefinitionError(f"there is no scheme `{plain(self.scheme)}`; {nearest(self.scheme, PRESETS)}")
            return PRESETS[self.scheme]
        module, _, name = self.scheme.partition(":")
        try:
            scheme = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise DefinitionError(f"cannot import `{plain(self.scheme)}`: {error}") from None
        if isinstance(scheme, Preset):
            return scheme
        if isinstance(scheme, type) and issubclass(scheme, AbstractController):
            return Preset(scheme, (scheme.__doc__ or name).strip())
        raise DefinitionError(f"`{plain(self.scheme)}` is neither a `Preset` nor the class of a law")

    def gains(self) -> Gains:
        """Return the tuned and fixed gains."""
        return gains_of(self.scheme, self.preset, self.form)

    def described(self, task: BenchmarkTask) -> ScenarioDescription:
        """Return the scenario of a `task` with this scheme.

        Raises DefinitionError if the scheme does not fit the task.
        """
        own = ":" in self.scheme
        name = self.scheme.rpartition(":")[2] if own else self.scheme
        scheme: dict[str, Any] = {"name": name}
        if self._has_envelope:
            scheme["transformation"] = {"kind": "prescribed_performance", **task.tolerance}
        if self.form == "sampled-data":
            scheme["sampled_data"] = dict(task.sampled_data)
        data = {
            "title": task.title,
            "source": task.source,
            **task.scenario,
            "scheme": scheme,
            "tolerance": task.tolerance,
        }
        changes = {f"scheme.{path}": value for path, value in self.gains().fixed.items()}
        return validated(data, changes, form=with_scheme(name, self.preset) if own else ScenarioDescription)

    @property
    def _has_envelope(self) -> bool:
        transformation = self.preset.values.get("transformation")
        needed = [] if transformation is None else [each.name for each in parameters_of(transformation.part)]
        return "performance" in needed


def entries(
    schemes: Sequence[str] | None = None, more: Sequence[str] = (), forms: Sequence[Form] = FORMS
) -> list[BenchmarkEntry]:
    """Return the entries of a round.

    - `schemes`: names; None: all complete presets of the package.
    - `more`: further schemes, as `package.module:Name`.
    - `forms`: of each scheme.

    Raises DefinitionError if a scheme does not exist or has nothing to tune.
    """
    listed = [name for name, preset in PRESETS.items() if preset.complete] if schemes is None else schemes
    result = [BenchmarkEntry(name, form) for form in forms for name in dict.fromkeys([*listed, *more])]
    for entry in result:
        entry.gains()
    return result


def forms_of(word: str) -> tuple[Form, ...]:
    """Return the forms for a `word`: `sampled-data`, `printed` or `both`.

    Raises DefinitionError for any other word.
    """
    if word == "both":
        return FORMS
    forms = tuple(form for form in FORMS if form == word)
    if not forms:
        raise DefinitionError(f"there is no form `{plain(word)}`; {nearest(word, [*FORMS, 'both'])}")
    return forms
