"""A scheme that takes part, in one of its forms."""

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
from .task import LeagueTask

Form = Literal["sampled-data", "printed"]
FORMS: tuple[Form, ...] = ("sampled-data", "printed")
"""With the estimator, learning, prediction and limits that all share, or as its source prints it."""

CALLED = {("computed_torque", "sampled-data"): "computed_torque + disturbance observer"}
"""What a form of a scheme is better known as."""


@dataclass(frozen=True)
class Entry:
    """A scheme in a form.

    - `scheme`: its name in `slidax list schemes`, or `package.module:Name` of a preset or of a law's class.
    - `form`: with all that the sampled-data form gives, or as it is printed.
    """

    scheme: str
    form: Form

    @property
    def name(self) -> str:
        """What tables call it."""
        return CALLED.get((self.scheme, self.form), self.scheme.rpartition(":")[2])

    @property
    def file(self) -> str:
        """What files are called that are about it."""
        return f"{self.scheme.replace(':', '.')}--{self.form}"

    @cached_property
    def preset(self) -> Preset:
        """Its law with its parts.

        Raises DefinitionError if there is no such scheme.
        """
        if ":" not in self.scheme:
            if self.scheme not in PRESETS:
                raise DefinitionError(f"there is no scheme `{plain(self.scheme)}`; {nearest(self.scheme, PRESETS)}")
            return PRESETS[self.scheme]
        module, _, name = self.scheme.partition(":")
        try:
            found = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise DefinitionError(f"cannot import `{plain(self.scheme)}`: {error}") from None
        if isinstance(found, Preset):
            return found
        if isinstance(found, type) and issubclass(found, AbstractController):
            return Preset(found, (found.__doc__ or name).strip())
        raise DefinitionError(f"`{plain(self.scheme)}` is neither a `Preset` nor the class of a law")

    def gains(self) -> Gains:
        """What is tuned of it, and what is set."""
        return gains_of(self.scheme, self.preset, self.form)

    def described(self, task: LeagueTask) -> ScenarioDescription:
        """The task's scenario with this scheme.

        - `task`: what it is asked.

        Raises DefinitionError if they do not fit each other.
        """
        own = ":" in self.scheme
        name = self.scheme.rpartition(":")[2] if own else self.scheme
        scheme: dict[str, Any] = {"name": name}
        if self._draws_an_envelope:
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
        form = with_scheme(name, self.preset) if own else ScenarioDescription
        return validated(data, changes, form=form)

    @property
    def _draws_an_envelope(self) -> bool:
        given = self.preset.given.get("transformation")
        needed = [one.name for one in parameters_of(given.part)] if given is not None else []
        return "performance" in needed


def entries(
    schemes: Sequence[str] | None = None, more: Sequence[str] = (), forms: Sequence[Form] = FORMS
) -> list[Entry]:
    """Who takes part.

    - `schemes`: names; all complete presets of the package if None.
    - `more`: others, by `package.module:Name`.
    - `forms`: in which.

    Raises DefinitionError if there is no such scheme, or nothing of it can be tuned.
    """
    listed = [name for name, preset in PRESETS.items() if preset.complete] if schemes is None else schemes
    found = [Entry(name, form) for form in forms for name in dict.fromkeys([*listed, *more])]
    for one in found:
        one.gains()
    return found


def forms_of(word: str) -> tuple[Form, ...]:
    """The forms that a word asks for.

    - `word`: one of them, or `both`.

    Raises DefinitionError if it is none.
    """
    if word == "both":
        return FORMS
    found = tuple(form for form in FORMS if form == word)
    if not found:
        raise DefinitionError(f"there is no form `{plain(word)}`; {nearest(word, [*FORMS, 'both'])}")
    return found
