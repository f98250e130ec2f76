"""Invalid robot files: a valid file with one change, and the words that the error must contain."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = ("0", "-1", "nan", "inf", "1e308", "-1e308", "1e-320", "", "1 2 3", "0 0 0")
NAMES = ("abc", "world", "upper", "fore", "base", "elbow", "free", "ball", "fixed", "slide", "é", "..", "/")
WORDS = [*NUMBERS, *NAMES]


@dataclass(frozen=True)
class BadFile:
    """One case.

    - `title`: what is wrong.
    - `text`: contents of the file; bytes are written to a file on disk.
    - `named`: words that the error must contain, among them the name of the link or joint.
    - `arguments`: arguments of the call.
    """

    title: str
    text: str | bytes
    named: tuple[str, ...]
    arguments: dict[str, Any] = field(default_factory=dict)

    def source(self, folder: Path) -> str | Path:
        """Return the text, or the path of a file with it."""
        if isinstance(self.text, str):
            return self.text
        (folder / "robot.xml").write_bytes(self.text)
        return folder / "robot.xml"


def changed(text: str, *changes: str) -> str:
    """A text with pieces replaced."""
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert text.count(old) == 1, f"{old!r} is there {text.count(old)} times"
        text = text.replace(old, new)
    return text


def damaged(text: str, rng: np.random.Generator) -> str:
    """Return XML text with one to three parts changed, left out or doubled."""
    for _ in range(rng.integers(1, 4)):
        value, attribute, element, other = (
            (matches := list(re.finditer(pattern, text)))[rng.integers(len(matches))].span()
            for pattern in (r'"[^"]*"', r' \w+="[^"]*"', r"<[^<>]*/>", r"<[^<>]*/>")
        )
        place = int(rng.integers(len(text)))
        start, end, new = [
            (*value, f'"{rng.choice(WORDS)}"'),
            (*attribute, ""),
            (*element, ""),
            (element[0], element[0], text[slice(*other)]),
            (place, place + int(rng.integers(2)), str(rng.choice(list('<>"/= \n&0a')))),
        ][rng.integers(5)]
        text = text[:start] + new + text[end:]
    return text
