"""Tasks and entries of the benchmark, and the gains to tune.

An entry is a scheme in one form: `sampled-data`, for a fixed sample time, or `printed`, the law as published.
"""

from __future__ import annotations

import importlib
import inspect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from slidax.core.errors import DefinitionError, locate_errors, nearest_word, plain_name
from slidax.core.parameter import Parameter, parameters_of
from slidax.law.controllers import AbstractController
from slidax.law.presets import Preset, PresetPart
from slidax.scenarios.descriptions import AbstractDescription, input_field
from slidax.scenarios.load import validate_text
from slidax.scenarios.scenario import ScenarioDescription, with_scheme
from slidax.scenarios.schemes import PRESETS
from slidax.scenarios.uncertainty import AbstractSet, AnySet, Uncertainty
from slidax.scenarios.yaml_text import read_yaml, validation_error

VERSION = 1
"""Version of the tasks, the tuned gains and the rules; results of different versions are not compared."""

FOLDER = resources.files("slidax.studies.benchmark") / "tasks"


class CasesDescription(AbstractDescription):
    """Number and seed of random cases."""

    cases: int = input_field("number of cases", "", "[1, 1e6]")
    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """Seed of the random cases."""


class BenchmarkTask(AbstractDescription):
    """A task of the benchmark: scenario, tolerance band and uncertainty, the same for all schemes."""

    title: str
    """Title in one line."""
    about: list[str]
    """The difficulties of the task, such as `friction` or `delay`."""
    source: str
    """Source of the arm's data and of the other numbers."""
    scenario: dict[str, Any]
    """A scenario without a scheme."""
    sampled_data: dict[str, Any] = Field(default={})
    """Block `sampled_data` of every scheme in sampled-data form."""
    tolerance: dict[str, Any]
    """Tolerance band for the errors, as in a scenario; also the envelope of every scheme that has one."""
    uncertainty: Uncertainty
    """Sets of values unknown to every law, as in a scenario."""
    training: CasesDescription
    """Cases on which the tuner compares gains."""
    held_out: CasesDescription
    """Cases on which the tuned schemes are scored."""


def names() -> list[str]:
    """Return the names of the tasks, in alphabetical order."""
    return sorted(Path(entry.name).stem for entry in FOLDER.iterdir() if entry.name.endswith(".yaml"))


def task(name: str) -> BenchmarkTask:
    """Return a task by its `name`.

    Raises DefinitionError if the task does not exist, or if its file is invalid.
    """
    if name not in names():
        raise DefinitionError(f"there is no task `{name}`; {nearest_word(name, names())}")
    data = read_yaml((FOLDER / f"{name}.yaml").read_text(encoding="utf-8"))
    with locate_errors(name):
        try:
            return BenchmarkTask.model_validate(data)
        except ValidationError as error:
            raise validation_error(error, data) from None


FACTOR = 30.0
"""Gains of a user's scheme are searched from their own values divided by this factor to those multiplied by it."""

TUNABLE = ("one number", "one number or [n]", "[n]")


class GainDescription(AbstractDescription):
    """Range of a tuned gain, searched log-uniformly."""

    between: tuple[float, float]
    """The ends of the range, before they are scaled."""
    times: Literal["nothing", "inertia", "strength", "period"] = "nothing"
    """Scale of the ends. `inertia`: diagonal of the nominal inertia matrix at the start, joint by joint; `strength`:
    norm of the drives' torque limits; `period`: the sample time."""


class SchemeGains(AbstractDescription):
    """Gains of a scheme of this package, by dotted path in the scheme, as `gains.yaml` lists them for both forms."""

    tuned: dict[str, GainDescription]
    """Ranges of gains tuned in both forms."""
    printed: dict[str, GainDescription] = Field(default={})
    """Ranges of gains tuned only in printed form."""
    sampled_data: dict[str, GainDescription] = Field(default={})
    """Ranges of gains tuned only in sampled-data form."""
    fixed: dict[str, Any] = Field(default={})
    """Values of gains that are not tuned."""
    fixed_sampled_data: dict[str, Any] = Field(default={})
    """Values of gains that are not tuned, in sampled-data form only."""


@dataclass(frozen=True)
class Gains:
    """Tuned and fixed gains of a scheme in one form, by dotted path in the scheme.

    - `tuned`: ranges of the gains to tune.
    - `fixed`: values of the other gains.
    """

    tuned: dict[str, GainDescription]
    fixed: dict[str, Any]

    def sets(self, base: ScenarioDescription) -> dict[str, AbstractSet]:
        """Return the sets of values from which the gains are tuned, by path in the scenario.

        A range can scale with the arm's inertia, its torque limits or the sample time.

        - `base`: description of the scenario.

        Raises DefinitionError if a range scales with torque limits that the arm does not have.
        """
        return {f"scheme.{path}": _set(gain, base) for path, gain in self.tuned.items()}


@cache
def _listed() -> dict[str, SchemeGains]:
    text = (resources.files("slidax.studies.benchmark") / "gains.yaml").read_text(encoding="utf-8")
    return TypeAdapter(dict[str, SchemeGains]).validate_python(read_yaml(text))


def gains_of(scheme: str, preset: Preset, form: str) -> Gains:
    """Return the gains of a scheme: those of `gains.yaml`, else every declared positive parameter.

    - `scheme`, `preset`: name of the scheme, and its law with all parts.
    - `form`: `sampled-data` or `printed`.

    Raises DefinitionError if there is no gain to tune.
    """
    sampled = form == "sampled-data"
    if scheme in _listed():
        own = _listed()[scheme]
        tuned = {**own.tuned, **(own.sampled_data if sampled else own.printed)}
        return Gains(tuned, {**own.fixed, **(own.fixed_sampled_data if sampled else {})})
    tuned = dict(_by_declarations(preset))
    if not tuned:
        raise DefinitionError(
            f"`{scheme}` has nothing to tune: it declares no parameter > 0 with a default; declare one, as "
            "docs/your-own-law.md shows"
        )
    return Gains(tuned, {})


def _by_declarations(preset: Preset) -> list[tuple[str, GainDescription]]:
    """Return all positive parameters of the law and its parts (without the envelope), around their own values."""
    gains = []
    for parameter in parameters_of(preset.law):
        value = preset.values.get(parameter.name, None if parameter.required else parameter.default)
        if isinstance(value, PresetPart):
            if parameter.name == "transformation":
                continue
            for inner in parameters_of(value.part):
                gains += _gain(inner, value.values.get(inner.name), f"{parameter.name}.")
        elif parameter.name != "nominal":
            gains += _gain(parameter, value, "")
    return gains


def _gain(declared: Parameter, value: Any, prefix: str) -> list[tuple[str, GainDescription]]:
    value = declared.default if value is None and not declared.required else value
    if declared.shape not in TUNABLE or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        return []
    ends = [end.number for end in declared.range.ends]
    low, high = value / FACTOR, value * FACTOR
    if any(end is None for end in ends):
        # An end of the range is another gain: values near the scheme's own are likely to respect it.
        low, high = value / 1.2, value * 1.2
    else:
        low = max(low, ends[0] + 0.02 * (value - ends[0])) if ends[0] is not None and ends[0] > -math.inf else low
        high = min(high, value + 0.98 * (ends[1] - value)) if ends[1] is not None and ends[1] < math.inf else high
    times: Literal["nothing", "inertia"] = "inertia" if declared.unit.startswith(("N m", "kg")) else "nothing"
    return [(f"{prefix}{declared.name}", GainDescription(between=(low, high), times=times))]


def _set(gain: GainDescription, base: ScenarioDescription) -> AbstractSet:
    scale: Any = 1.0
    moving = base.moving()
    if gain.times == "inertia":
        mass = np.diagonal(np.asarray(moving.arms.nominal.mass(moving.state0.q)))
        scale = np.array([float(f"{value:.3g}") for value in mass])
    elif gain.times == "strength":
        torque = np.broadcast_to(np.asarray(moving.drive.limits().torque), moving.state0.q.shape)
        if not np.isfinite(torque).all():
            raise DefinitionError(
                "a gain scales with the drives' torque limits, and the task has none: set `actuator.torque`"
            )
        scale = float(f"{np.linalg.norm(torque):.3g}")
    elif gain.times == "period":
        scale = base.simulation.period
    ends = [(end * scale).tolist() if isinstance(scale, np.ndarray) else end * scale for end in gain.between]
    return TypeAdapter(AnySet).validate_python({"between": ends, "distribution": "log_uniform"})


Form = Literal["sampled-data", "printed"]
FORMS: tuple[Form, ...] = ("sampled-data", "printed")
"""Forms of a scheme: with the common estimator, learning, prediction and limits, or as its source prints it."""

COMMON_NAMES = {("computed_torque", "sampled-data"): "computed_torque + disturbance observer"}
"""Names in tables that are better known than the scheme's own, by scheme and form."""


@dataclass(frozen=True)
class BenchmarkEntry:
    """A scheme that takes part in the benchmark, in one form.

    - `scheme`: a name of `slidax list schemes`, or `package.module:Name` of a preset or a controller class.
    - `form`: `sampled-data` or `printed`.
    """

    scheme: str
    form: Form

    @property
    def name(self) -> str:
        """Name of the scheme in tables."""
        return COMMON_NAMES.get((self.scheme, self.form), self.scheme.rpartition(":")[2])

    @property
    def file(self) -> str:
        """Name of the entry's files, without suffix."""
        return f"{self.scheme.replace(':', '.')}--{self.form}"

    @cached_property
    def preset(self) -> Preset:
        """The law of the scheme, with its parts and their values.

        Raises DefinitionError if the scheme does not exist.
        """
        if ":" not in self.scheme:
            if self.scheme not in PRESETS:
                raise DefinitionError(
                    f"there is no scheme `{plain_name(self.scheme)}`; {nearest_word(self.scheme, PRESETS)}"
                )
            return PRESETS[self.scheme]
        module, _, name = self.scheme.partition(":")
        try:
            scheme = getattr(importlib.import_module(module), name)
        except (ImportError, AttributeError, ValueError) as error:
            raise DefinitionError(f"cannot import `{plain_name(self.scheme)}`: {error}") from None
        if isinstance(scheme, Preset):
            return scheme
        if isinstance(scheme, type) and issubclass(scheme, AbstractController):
            return Preset(scheme, (scheme.__doc__ or name).strip())
        raise DefinitionError(f"`{plain_name(self.scheme)}` is neither a `Preset` nor the class of a law")

    @property
    def file_of_law(self) -> Path | None:
        """File of a user's law; None for a scheme of this package."""
        return Path(inspect.getfile(self.preset.law)) if ":" in self.scheme else None

    def gains(self) -> Gains:
        """Return the scheme's tuned and fixed gains in this form."""
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
        return validate_text(data, changes, form=with_scheme(name, self.preset) if own else ScenarioDescription)

    @property
    def _has_envelope(self) -> bool:
        transformation = self.preset.values.get("transformation")
        needed = [] if transformation is None else [each.name for each in parameters_of(transformation.part)]
        return "performance" in needed


def entries(
    schemes: Sequence[str] | None = None, more: Sequence[str] = (), forms: Sequence[Form] = FORMS
) -> list[BenchmarkEntry]:
    """Return the entries of a round.

    - `schemes`: names; None for all complete presets of the package.
    - `more`: additional schemes, as `package.module:Name`.
    - `forms`: forms of each scheme.

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
        raise DefinitionError(f"there is no form `{plain_name(word)}`; {nearest_word(word, [*FORMS, 'both'])}")
    return forms
