"""Adds to the docstrings that mkdocstrings reads from the sources what only a running slidax knows.

It runs in the environment of the site's builder, which has no JAX; the facts come from a file that `api` has written.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from griffe import Docstring, Extension, Object


class Facts(Extension):
    """An extension of griffe.

    - `path`: the file of facts, by full names.
    """

    def __init__(self, path: str) -> None:
        super().__init__()
        self.facts: dict[str, str] = json.loads(Path(path).read_text(encoding="utf-8"))

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Completes the docstring of a class, a function or a named value.

        - `obj`: as griffe has read it.
        """
        said = self.facts.get(obj.path)
        if said is None:
            return
        if obj.docstring is None:
            obj.docstring = Docstring(said, parent=obj)
        elif said not in obj.docstring.value:
            obj.docstring.value = f"{obj.docstring.value}\n\n{said}"
