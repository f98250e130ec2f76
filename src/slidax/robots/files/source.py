"""Where a robot file's text comes from, and its XML, guarded."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

from slidax._errors import DefinitionError

DEEPEST = 300
"""Elements inside of each other; MuJoCo's reader takes 500."""


@dataclass(frozen=True)
class Source:
    """A robot file.

    - `text`: of the file.
    - `path`: of the file; None if the text itself was given.
    - `root`: the XML's outermost element.
    """

    text: str
    path: Path | None
    root: ET.Element

    @property
    def folder(self) -> Path:
        """Where its relative paths begin: the file's folder, or for a text the working directory."""
        return self.path.parent.resolve() if self.path else Path.cwd()


def read(source: str | Path, root: str, other: str) -> Source:
    """A robot file, from its path or its text.

    - `source`: a path, or the XML itself: a text with `<` in it.
    - `root`: the name of its outermost element.
    - `other`: what to do if it is another, as a sentence that follows a semicolon.

    Raises DefinitionError if there is no such file, or no such XML in it.
    """
    path: Path | None = None
    text: str | bytes
    if isinstance(source, str) and ("<" in source or not source.strip()):
        text = source.lstrip("\ufeff")
    else:
        path = Path(source)
        try:
            text = path.read_bytes()
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or str(error)
            raise DefinitionError(f"the robot file `{source}` cannot be read: {why}") from error
    if not text.strip():
        raise DefinitionError(f"the robot file is empty; its XML must begin with <{root}>")
    tree = _parsed(text)
    if tree.tag != root:
        raise DefinitionError(f"a robot file with <{root}> is needed, and this is <{tree.tag}>; {other}")
    _refuse_xacro(tree)
    return Source(_decoded(text, tree), path, tree)


class _Guarded(ET.TreeBuilder):
    """Builds a tree, but of no document that defines entities, and of none that is nested without end."""

    depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:
        self.depth += 1
        if self.depth > DEEPEST:
            raise DefinitionError(f"the robot file has more than {DEEPEST} elements nested in each other")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ET.Element:
        self.depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: Any, system: Any) -> None:
        raise DefinitionError("the robot file has a DOCTYPE, which may define entities; remove it")


def _undeclared(text: str | bytes, error: ET.ParseError) -> str:
    """What to do about a prefix that is not declared, as old files for Gazebo have them; empty for another error."""
    line, column = error.position
    lines = text.splitlines()
    if error.code != expat.errors.codes[expat.errors.XML_ERROR_UNBOUND_PREFIX] or line > len(lines):
        return ""
    here = lines[line - 1]
    here = here.decode("utf-8", "replace") if isinstance(here, bytes) else here
    found = re.match(r"<([\w.-]+):[\w.-]+", here[column:])
    if found is None:
        return ""
    name, prefix = found[0][1:], found[1]
    return (
        f"; <{name}> has a prefix that nothing declares: remove the element, of which nothing is read here, or write "
        f'xmlns:{prefix}="{prefix}" into <{_root(text)}>'
    )


def _root(text: str | bytes) -> str:
    """The name of the outermost element, as far as it can be seen in a text that is no XML."""
    plain = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    found = re.search(r"<([A-Za-z_][\w.-]*)", plain)
    return found[1] if found else "robot"


def _parsed(text: str | bytes) -> ET.Element:
    try:
        return ET.XML(text, ET.XMLParser(target=_Guarded()))
    except ET.ParseError as error:
        raise DefinitionError(f"the robot file is not XML: {error}{_undeclared(text, error)}") from error
    except (LookupError, ValueError) as error:
        if isinstance(error, DefinitionError):
            raise
        raise DefinitionError(f"the robot file cannot be decoded: {error}") from error


def _decoded(text: str | bytes, tree: ET.Element) -> str:
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError:
        # The reader of XML knew the encoding by the declaration, or by the first bytes.
        return ET.tostring(tree, encoding="unicode")


def elements(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Every element with how to find it: the nearest one around it that has a name, or it itself.

    - `root`: the outermost.
    """
    stack = [(f"<{root.tag}>", root)]
    while stack:
        where, element = stack.pop()
        name = element.get("name")
        here = f"{element.tag} `{name}`" if name else where
        yield here, element
        stack.extend((here, child) for child in reversed(element))


def owner_at(text: str, tag: str, line: int) -> str:
    """How to find the element that begins in a line, as `elements` says it; empty if there is none.

    - `text`: of the file, which is XML.
    - `tag`: of the element.
    - `line`: counted from 1.
    """
    parser, around, found = expat.ParserCreate(), [""], [""]

    def start(name: str, attributes: dict[str, str]) -> None:
        own = attributes.get("name")
        around.append(f"{name} `{own}`" if own else around[-1])
        if parser.CurrentLineNumber == line and name == tag:
            found.append(around[-1])

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: around.pop()
    parser.Parse(text, True)
    return found[-1]


def _refuse_xacro(root: ET.Element) -> None:
    for where, element in elements(root):
        left = next((value for value in element.attrib.values() if "${" in value or "$(" in value), None)
        if left is None and element.tag.startswith("{") and "xacro" in element.tag:
            left = "xacro:" + element.tag.rpartition("}")[2]
        if left is not None:
            raise DefinitionError(f"{where} still has xacro in it, `{left}`; run `xacro FILE > robot.urdf` first")
