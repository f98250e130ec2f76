"""Named schemes: a law with its parts and parameter values, for Python and for scenario files."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import equinox as eqx

from slidax._errors import DefinitionError, located, nearest
from slidax.parts import Parameter, parameters_of
from slidax.robots import AbstractRobot

from .controller import AbstractController


class Given:
    """A part of a preset, with the parameter values of the preset.

    - `part`: its class.
    - `values`: by parameter; the call must contain the missing ones.
    """

    def __init__(self, part: type[eqx.Module], **values: Any) -> None:
        self.part = part
        self.values = values

    def __repr__(self) -> str:
        return f"{self.part.__name__}({', '.join(f'{name}={value}' for name, value in self.values.items())})"


class Preset:
    """A published or usual scheme: a law with parts and parameter values. A call with a robot returns the controller.

        law = cftsmppc(nominal, performance=FixedTime(1.0, 0.01, 2.0, 3.0), overshoot=0.2, bound=bound, k1=0.3)

    A keyword argument is a part or a parameter of the law, a mapping of parameters for one of its parts, or a parameter
    that only one of its parts has: `k1=0.3` is `surface={"k1": 0.3}` if no other part has a k1. A part of another
    class replaces the preset's.

    - `law`: the class of the controller.
    - `title`: one line, then a longer description.
    - `source`: source of the values.
    - `values`: parts, as `Given`, and parameter values, by the fields of the law.
    """

    def __init__(self, law: type[AbstractController], title: str, *, source: str = "", **values: Any) -> None:
        self.law = law
        self.title = title
        self.source = source
        self.values: dict[str, Any] = values
        parameters = self._own()
        listed = [f"- `{parameter.name}`: {parameter.meaning}." for parameter in parameters]
        kinds = inspect.Parameter
        named = [kinds(p.name, kinds.KEYWORD_ONLY, default=values.get(p.name)) for p in parameters]
        self.__signature__ = inspect.Signature([kinds("nominal", kinds.POSITIONAL_OR_KEYWORD), *named])
        self.__doc__ = "\n".join([inspect.cleandoc(title), "", "- `nominal`: the robot as the law knows it.", *listed])

    def __call__(self, nominal: AbstractRobot, **values: Any) -> AbstractController:
        """Return the controller.

        - `nominal`: the robot as the law knows it.
        - `values`: parts and parameters that the preset lacks, or that replace its own.

        Raises DefinitionError if a value is missing, unknown, out of its range or does not fit the joints.
        """
        placed = self.placed(values)
        parts: dict[str, Any] = {}
        for name in {**self.values, **placed}:
            value, preset = placed.get(name, {}), self.values.get(name)
            if isinstance(preset, Given) and isinstance(value, Mapping):
                with located(name):
                    parts[name] = _build(preset.part, {**preset.values, **value})
            else:
                parts[name] = placed.get(name, preset)
        return _build(self.law, {"nominal": nominal, **parts})

    def placed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values with each parameter of a part under the name of that part.

        - `values`: by field of the law, or by parameter of just one of its parts.

        Raises DefinitionError for a name that no part has, or several.
        """
        own = {parameter.name for parameter in self._own()}
        placed: dict[str, Any] = {name: value for name, value in values.items() if name in own}
        for name, value in values.items():
            if name in own:
                continue
            owners = self.owners(name)
            if len(owners) != 1:
                if owners:
                    raise DefinitionError(f"`{name}` is of {' and of '.join(owners)}: say which")
                known = own.union(*(_names(part) for part in self._parts().values()))
                raise DefinitionError(f"`{name}` is unknown; {nearest(name, sorted(known))}")
            part = placed.setdefault(owners[0], {})
            if not isinstance(part, Mapping):
                raise DefinitionError(
                    f"`{name}` is a number of `{owners[0]}`, which is given as a whole; leave one out"
                )
            placed[owners[0]] = {**part, name: value}
        return placed

    @property
    def complete(self) -> bool:
        """True if it has every part of its law, so that only parameters of the task and the arm are missing."""
        return all(parameter.name in self.values for parameter in self._own() if parameter.required)

    def owners(self, name: str) -> list[str]:
        """Return the parts of the preset that have a parameter of this name."""
        return [field for field, part in self._parts().items() if name in _names(part)]

    def _own(self) -> list[Parameter]:
        return [parameter for parameter in parameters_of(self.law) if parameter.name != "nominal"]

    def _parts(self) -> dict[str, type[eqx.Module]]:
        return {name: value.part for name, value in self.values.items() if isinstance(value, Given)}


def _names(part: type) -> set[str]:
    return {parameter.name for parameter in parameters_of(part)}


def _build(part: type[Any], values: dict[str, Any]) -> Any:
    missing = [p.name for p in parameters_of(part) if p.required and p.name not in values]
    if missing:
        raise DefinitionError(f"`{part.__name__}` needs {' and '.join(f'`{name}`' for name in missing)}")
    return part(**values)
