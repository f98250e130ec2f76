"""Names of joints, short enough for tables."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import takewhile


def short_names(names: Sequence[str]) -> list[str]:
    """The names without the words that all of them begin or end with: `panda_joint1` is `joint1`.

    A name that would be left without a letter keeps its words.

    - `names`: of the joints.
    """
    before = _shared(names)
    after = _shared([name[::-1] for name in names])
    for start, end in ((before, after), (before, 0), (0, after)):
        short = [name[start : len(name) - end] for name in names]
        if all(re.search("[^\\W\\d_]", name) for name in short):
            return short
    return list(names)


def _shared(names: Sequence[str]) -> int:
    """Length of the words that all names begin with, including the separator."""
    words = [re.findall("[^ _/.-]*[ _/.-]+", name) for name in names]
    alike = takewhile(lambda same: len(set(same)) == 1, zip(*words, strict=False)) if len(names) > 1 else ()
    return sum(len(same[0]) for same in alike)
