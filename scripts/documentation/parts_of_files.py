"""Whether a YAML block of a page is one that slidax takes."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from typing import Any

from .blocks import PageError

PATHS = ("truth", "uncertainty")
"""Blocks of a scenario whose keys are paths themselves."""


def check_yaml(text: str, part_of: str, folder: Path) -> None:
    """Reads a block as slidax reads such a file; a block whose first line is `# NAME.yaml` is written down as well.

    - `text`: of the block.
    - `part_of`: the built-in scenario whose part it is; `unread` if only its YAML is read; empty for a whole file.
    - `folder`: where it is written.

    Raises PageError if it is not whole and no scenario is named, DefinitionError if slidax refuses it.
    """
    from slidax.scenarios import parse
    from slidax.scenarios.load import read_yaml

    if name := re.match(r"# (\S+\.ya?ml)\n", text):
        (folder / name[1]).write_text(text, encoding="utf-8")
    read: Any = read_yaml(text)
    if part_of == "unread":
        return
    if part_of:
        whole = files("slidax.scenarios.built_in").joinpath(f"{part_of}.yaml").read_text(encoding="utf-8")
        parse(whole, dotted(read))
    elif not isinstance(read, dict):
        raise PageError("a YAML block must be a mapping")
    elif {"robot", "scheme", "trajectory"} <= set(read):
        parse(text)
    elif "study" in read:
        from slidax.studies import read_study

        (folder / "a-study-on-the-page.yaml").write_text(text, encoding="utf-8")
        read_study(folder / "a-study-on-the-page.yaml", {})
    elif not ("requirements" in read and "robot" in read):
        raise PageError("this YAML is no whole file: say of which scenario it is a part, `<!-- part of: NAME -->`")


def dotted(read: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """The numbers of a mapping by their paths, so that what stands beside them in the scenario remains.

    - `read`: a mapping of mappings; one that has a `kind` is given whole.
    - `prefix`: the path of the mapping.
    """
    found: dict[str, Any] = {}
    for key, value in read.items():
        path = f"{prefix}{key}"
        whole = not isinstance(value, dict) or "kind" in value or key in PATHS
        found |= {path: value} if whole else dotted(value, f"{path}.")
    return found
