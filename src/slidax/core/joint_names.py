"""Match column or joint names in data with the joint names of a robot."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence

NUMBERED = re.compile(r"joint \d+")
"""Default name of a joint."""


def bare_name(name: str) -> str:
    """Return a name in lower case, without spaces, quotation marks and punctuation: `"Joint_1 "` becomes `joint1`.

    Neighbouring numbers stay separate: `joint_1_1` becomes `joint1.1`, since `joint_11` is another joint.
    """
    folded = unicodedata.normalize("NFKC", name).casefold()
    parts = re.sub(r"(?<=\d)[\W_]+(?=\d)", "\n", folded)
    return "".join(letter for letter in parts if letter.isalnum() or letter == "\n").replace("\n", ".") or name


def match_names(names: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """Return the index in `names` of each wanted name; wanted names without a match are left out.

    An exact match takes precedence. Otherwise a name matches if it differs only in case, spaces or punctuation, and is
    the only such name.

    - `names`: names in the data, without duplicates.
    - `wanted`: names of the robot's joints, without duplicates.
    """
    exact = {name: names.index(name) for name in wanted if name in names}
    taken = set(exact.values())
    rest = {index: bare_name(name) for index, name in enumerate(names) if index not in taken}
    in_data, in_robot = Counter(rest.values()), Counter(bare_name(name) for name in wanted)
    unique = {key: index for index, key in rest.items() if in_data[key] == 1}
    indices = {
        name: exact.get(name, unique.get(bare_name(name)) if in_robot[bare_name(name)] == 1 else None)
        for name in wanted
    }
    return {name: index for name, index in indices.items() if index is not None}


def are_numbered(names: Sequence[str]) -> bool:
    """Return True if all names of a robot's joints are default names: `joint 1`, `joint 2` and so on."""
    return all(NUMBERED.fullmatch(name) for name in names)


def joint_label(name: str) -> str:
    """A joint's name in a sentence: "joint 2" for a default name, else "joint `elbow`"."""
    return name if NUMBERED.fullmatch(name) else f"joint `{name}`"


def quote_names(names: Sequence[str]) -> str:
    """Names in a message: "`shoulder`, `elbow`"."""
    return ", ".join(f"`{name}`" for name in names)
