"""A named scheme: a law with its parts and numbers, read by Python and by scenario files alike."""

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
    """A part of a preset, with the numbers that the preset gives.

    - `part`: its class.
    - `values`: numbers by the names of its parameters; what is missing must be given in the call.
    """

    def __init__(self, part: type[eqx.Module], **values: Any) -> None:
        self.part = part
        self.values = values

    def __repr__(self) -> str:
        return f"{self.part.__name__}({', '.join(f'{name}={value}' for name, value in self.values.items())})"


class Preset:
    """A law with parts and numbers that make a published or usual scheme; called with a robot it makes the controller.

        law = cftsmppc(nominal, performance=FixedTime(1.0, 0.01, 2.0, 3.0), overshoot=0.2, bound=bound, k1=0.3)

    What is given by name is a part or a number of the law, a mapping of numbers for one of its parts, or a number that
    just one of its parts has: `k1=0.3` is `surface={"k1": 0.3}` where no other part has a k1. A part of another class
    takes the place of the preset's.

    - `law`: the class of the controller.
    - `title`: one line for a person, then what else there is to say.
    - `source`: where the numbers come from.
    - `given`: parts, as `Given`, and numbers, by the fields of the law.
    """

    def __init__(self, law: type[AbstractController], title: str, *, source: str = "", **given: Any) -> None:
        self.law = law
        self.title = title
        self.source = source
        self.given: dict[str, Any] = given
        listed = [f"- `{one.name}`: {one.meaning}." for one in self._own()]
        kinds = inspect.Parameter
        named = [kinds(one.name, kinds.KEYWORD_ONLY, default=given.get(one.name)) for one in self._own()]
        self.__signature__ = inspect.Signature([kinds("nominal", kinds.POSITIONAL_OR_KEYWORD), *named])
        self.__doc__ = "\n".join([inspect.cleandoc(title), "", "- `nominal`: the robot as the law knows it.", *listed])

    def __call__(self, nominal: AbstractRobot, **given: Any) -> AbstractController:
        """The controller.

        - `nominal`: the robot as the law knows it.
        - `given`: parts and numbers in place of the preset's, or that it does not give.

        Raises DefinitionError if something is missing, unknown, out of its range or does not fit the joints.
        """
        placed = self.placed(given)
        made: dict[str, Any] = {}
        for name in {**self.given, **placed}:
            value, preset = placed.get(name, {}), self.given.get(name)
            if isinstance(preset, Given) and isinstance(value, Mapping):
                with located(name):
                    made[name] = _made(preset.part, {**preset.values, **value})
            else:
                made[name] = placed.get(name, preset)
        return _made(self.law, {"nominal": nominal, **made})

    def placed(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """What is given, with numbers of parts under the names of these parts.

        - `given`: by the names of the law's fields, or of parameters that just one of its parts has.

        Raises DefinitionError for a name that no part has, or several.
        """
        own = {one.name for one in self._own()}
        placed: dict[str, Any] = {name: value for name, value in given.items() if name in own}
        for name, value in given.items():
            if name in own:
                continue
            owners = self.owners(name)
            if len(owners) != 1:
                known = sorted(own | {one.name for part in self._parts().values() for one in parameters_of(part)})
                said = (
                    f"is of {' and of '.join(owners)}: say which" if owners else f"is unknown; {nearest(name, known)}"
                )
                raise DefinitionError(f"`{name}` {said}")
            part = placed.setdefault(owners[0], {})
            if not isinstance(part, Mapping):
                raise DefinitionError(
                    f"`{name}` is a number of `{owners[0]}`, which is given as a whole; leave one out"
                )
            placed[owners[0]] = {**part, name: value}
        return placed

    @property
    def complete(self) -> bool:
        """Whether it gives every part of its law, so that only numbers of the task and the arm are missing."""
        return all(one.name in self.given for one in self._own() if one.required)

    def owners(self, name: str) -> list[str]:
        """The parts of the preset that have a parameter.

        - `name`: of the parameter.
        """
        return [field for field, part in self._parts().items() if name in {one.name for one in parameters_of(part)}]

    def _own(self) -> list[Parameter]:
        return [one for one in parameters_of(self.law) if one.name != "nominal"]

    def _parts(self) -> dict[str, type[eqx.Module]]:
        return {name: given.part for name, given in self.given.items() if isinstance(given, Given)}


def _made(part: type[Any], values: dict[str, Any]) -> Any:
    missing = [one.name for one in parameters_of(part) if one.required and one.name not in values]
    if missing:
        raise DefinitionError(f"`{part.__name__}` needs {' and '.join(f'`{name}`' for name in missing)}")
    return part(**values)
