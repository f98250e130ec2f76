"""Assumptions of a reader as warnings that name file, element and remedy."""

from __future__ import annotations

import re
import warnings

from slidax._errors import DefinitionError, DefinitionWarning

MOST = 4
"""Owners that a warning lists by name."""


class Notes:
    """Assumptions of one reading; the same assumption for several links or joints is one warning, which lists them."""

    def __init__(self) -> None:
        self._owners: dict[tuple[str, str], list[str]] = {}

    def add(self, text: str, owner: str = "") -> None:
        """Note an assumption.

        - `text`: a sentence without its period, and the remedy; `{}` stands for the owners.
        - `owner`: the link or joint, such as "link `forearm`".
        """
        before, _, after = text.partition("{}")
        owners = self._owners.setdefault((before, after), [])
        if owner and owner not in owners:
            owners.append(owner)

    @property
    def sentences(self) -> list[str]:
        """The assumptions in their order."""
        return [f"{before}{_listed(owners)}{after}" for (before, after), owners in self._owners.items()]

    def explain(self, error: DefinitionError) -> DefinitionError:
        """Return the error with the notes about links or joints that it names, or with all if it names none."""
        named = set(re.findall(r"`[^`]*`", error.message))
        hints = [
            f"{before}{_listed(owners)}{after}"
            for (before, after), owners in self._owners.items()
            if not named or named & set(re.findall(r"`[^`]*`", " ".join(owners)))
        ]
        told = error.message + "".join(f"; note that {hint}" for hint in hints)
        return DefinitionError(told, where=error.where).offering(error.setting)

    def warn(self, source: str, stacklevel: int) -> None:
        """Raise one `DefinitionWarning` for each assumption.

        - `source`: path of the file, or the robot's name.
        - `stacklevel`: of `warnings.warn`, relative to the caller.
        """
        for sentence in self.sentences:
            warnings.warn(f"{source}: {sentence}", DefinitionWarning, stacklevel=stacklevel + 1)


def _listed(owners: list[str]) -> str:
    if len(owners) <= 1:
        return "".join(owners)
    shown = owners[:MOST]
    rest = len(owners) - len(shown)
    if rest:
        return f"{', '.join(shown)} and {rest} more"
    return f"{', '.join(shown[:-1])} and {shown[-1]}"
