"""Which column of a table is which quantity of which joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError

from .log import Log

TIMES = ("t", "time", "timestamp", "seconds")
"""What the column of times may be called."""

QUANTITIES = {
    "q": ("q", "position", "pos"),
    "dq": ("dq", "velocity", "vel", "qd"),
    "tau": ("tau", "torque", "effort", "tau_J"),
}
"""What a quantity may be called in a column's name, before or after the joint."""


@dataclass(frozen=True)
class Columns:
    """Where a table has its times and, for each quantity that it has, the joints in the arm's order.

    - `time`: name of the column.
    - `of`: names of columns by quantity.
    """

    time: str
    of: dict[str, list[str]]

    @classmethod
    def found(cls, titles: Sequence[str], joints: Sequence[str], source: str) -> Columns:
        """The columns by their titles: `q1`, `q_1`, `NAME` or `NAME.position`; `tau_1`, `NAME.effort`; and so on.

        - `titles`: of the columns; a unit in brackets behind does not matter.
        - `joints`: the arm's joints, in its order.
        - `source`: what is read, for messages.

        Raises DefinitionError if times, a position or a torque is missing.
        """
        bare = {re.sub(r"\s*\[.*\]$", "", title).strip().lower(): title for title in titles}
        time = next((bare[name] for name in TIMES if name in bare), None)
        if time is None:
            raise DefinitionError(f"{source} has no column of times: call it `time` [s]; it has {_some(titles)}")
        of: dict[str, list[str]] = {}
        for quantity, words in QUANTITIES.items():
            matched = [_match(bare, words, number + 1, name) for number, name in enumerate(joints)]
            known = [title for title in matched if title is not None]
            if len(known) == len(joints):
                of[quantity] = known
            elif quantity != "dq" or known:
                missing = joints[matched.index(None)]
                number = matched.index(None) + 1
                raise DefinitionError(
                    f"{source} has no `{quantity}` of joint `{missing}`: call its column `{quantity}_{number}` or "
                    f"`{missing}.{words[1]}`; there are {_some(titles)}"
                )
        return cls(time, of)

    def log(self, source: str, joints: Sequence[str], table: Mapping[str, np.ndarray]) -> Log:
        """The log in a table that has these columns.

        - `source`: what was read, for messages.
        - `joints`: the arm's joints, in its order.
        - `table`: each column by its title.
        """
        values = {name: np.stack([table[title] for title in titles], axis=1) for name, titles in self.of.items()}
        return Log(source, tuple(joints), table[self.time], values["q"], values["tau"], values.get("dq"))


def _match(bare: Mapping[str, str], words: Sequence[str], number: int, joint: str) -> str | None:
    name = joint.lower()
    for word in (word.lower() for word in words):
        for form in (f"{word}{number}", f"{word}_{number}", f"{word}[{number}]", f"{name}.{word}", f"{word}.{name}"):
            if form in bare:
                return bare[form]
        for form in (f"{word}_{name}", f"{name}_{word}"):
            if form in bare:
                return bare[form]
    return bare.get(name) if words[0] == "q" else None


def _some(titles: Sequence[str]) -> str:
    shown = ", ".join(f"`{title}`" for title in titles[:8])
    return f"{shown}, ..." if len(titles) > 8 else shown
