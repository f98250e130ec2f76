"""Match column or joint names in data with the joint names of a robot."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence

NUMBERED = re.compile(r"joint \d+")
"""A joint that no file has named."""


def bare_name(name: str) -> str:
    """A name without case, spaces, quotation marks and punctuation: `"Joint_1 "` becomes `joint1`.

    Two numbers stay apart: `joint_1_1` becomes `joint1.1`, since `joint_11` is another joint.

    - `name`: any text.
    """
    folded = unicodedata.normalize("NFKC", name).casefold()
    parts = re.sub(r"(?<=\d)[\W_]+(?=\d)", "\n", folded)
    return "".join(letter for letter in parts if letter.isalnum() or letter == "\n").replace("\n", ".") or name


def match_names(names: Sequence[str], wanted: Sequence[str]) -> dict[str, int]:
    """The place of each wanted name among others; what is not among them is left out.

    - `names`: as the data has them, each once.
    - `wanted`: as the robot has them, each once.

    A name that is there exactly is taken. Otherwise one that differs in case, spaces or punctuation alone is, unless
    two names would then be alike.
    """
    exact = {name: names.index(name) for name in wanted if name in names}
    taken = set(exact.values())
    rest = {place: bare_name(name) for place, name in enumerate(names) if place not in taken}
    alike, twins = Counter(rest.values()), Counter(bare_name(name) for name in wanted)
    loose = {key: place for place, key in rest.items() if alike[key] == 1}
    places = {
        name: exact.get(name, loose.get(bare_name(name)) if twins[bare_name(name)] == 1 else None) for name in wanted
    }
    return {name: place for name, place in places.items() if place is not None}


def are_numbered(names: Sequence[str]) -> bool:
    """True if all names are `joint 1`, `joint 2` and so on, which says nothing of the joints.

    - `names`: of a robot's joints.
    """
    return all(NUMBERED.fullmatch(name) for name in names)


def joint_label(name: str) -> str:
    """A joint in a sentence: "joint 2", or "joint `elbow`" where it has a name of its own.

    - `name`: of the joint.
    """
    return name if NUMBERED.fullmatch(name) else f"joint `{name}`"


def quote_names(names: Sequence[str]) -> str:
    """Names in a message, "`shoulder`, `elbow`".

    - `names`: any.
    """
    return ", ".join(f"`{name}`" for name in names)
