"""Read the text and XML of a robot file within size limits, and check the files that a MuJoCo file names.

A named file that exists must be a regular file, not a pipe or a device, and within its size limit.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from slidax.core.errors import DefinitionError
from slidax.core.files import MEGABYTE, read_bytes, require_file

from .reading import Packages
from .xacro import expand

MOST_BYTES = 10 * MEGABYTE
"""Size limit of a file [bytes]; the largest known robot file has 1 MB."""

DEEPEST = 300
"""Most levels of nested elements; MuJoCo's reader allows 500."""


@dataclass(frozen=True)
class RobotFile:
    """A robot file: its text and parsed XML.

    - `path`: path of the file; None if the XML itself was passed.
    - `root`: outermost XML element.
    - `prefixed`: for each namespace prefix without a declaration, such as `gazebo`, an element's name with this prefix.
    """

    text: str
    path: Path | None
    root: ET.Element
    prefixed: Mapping[str, str] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        """Base of its relative paths: the file's folder, or for a text the working directory."""
        return self.path.parent.resolve() if self.path else Path.cwd()


def read_robot_file(
    source: str | Path,
    root: str,
    other: str,
    *,
    arguments: Mapping[str, str] | None = None,
    packages: Packages = (),
) -> RobotFile:
    """Read a robot file from its path or its text; a URDF file that ends in `.xacro` is expanded.

    - `source`: a path, or the XML itself: a text with `<` in it.
    - `root`: the required name of the outermost element: `robot` for URDF, `mujoco` for MJCF.
    - `other`: end of the message if the outermost element has another name, such as "from_mjcf reads <mujoco>".
    - `arguments`: arguments of a xacro file, by name.
    - `packages`: as in `from_urdf`.

    Raises DefinitionError if the file does not exist, or has no such XML.
    """
    path: Path | None = None
    text: str | bytes
    if isinstance(source, str) and ("<" in source or not source.strip()):
        text = source.lstrip("\ufeff")
    else:
        path = Path(source)
        if path.suffix.lower() == ".xacro" and root == "robot":
            text = expand(path, arguments or {}, packages, most=MOST_BYTES)
        else:
            text = read_bytes(path, "the robot file", most=MOST_BYTES)
    if not text.strip():
        raise DefinitionError(f"the robot file is empty; its XML must begin with <{root}>")
    tree, prefixed = _parsed(text)
    if tree.tag != root:
        raise DefinitionError(f"a robot file with <{root}> is needed, and this is <{tree.tag}>; {other}")
    _refuse_xacro(tree)
    return RobotFile(_decoded(text, tree), path, tree, prefixed)


class _TreeBuilder:
    """Build a tree, but reject documents that define entities or are nested too deeply.

    Prefixes remain part of the names: other readers of robot files ignore namespaces, and old files for Gazebo have
    undeclared prefixes.
    """

    def __init__(self) -> None:
        self.builder = ET.TreeBuilder()
        self.depth = 0
        self.declared: set[str] = {"xml", "xmlns"}
        self.prefixed: dict[str, str] = {}

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            raise DefinitionError(f"the robot file has more than {DEEPEST} elements nested in each other")
        self.declared |= {name.partition(":")[2] for name in attributes if name.startswith("xmlns:")}
        prefix, colon, _ = tag.partition(":")
        if colon and prefix not in self.declared:
            self.prefixed.setdefault(prefix, tag)
        self.builder.start(tag, attributes)

    def end(self, tag: str) -> None:
        self.depth -= 1
        self.builder.end(tag)

    def doctype(self, *_: Any) -> None:
        raise DefinitionError("the robot file has a DOCTYPE, which may define entities; remove it")


def _parsed(text: str | bytes) -> tuple[ET.Element, dict[str, str]]:
    """Return the tree, and for each undeclared prefix the name of an element that has it."""
    guarded, parser = _TreeBuilder(), expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = guarded.start, guarded.end
    parser.CharacterDataHandler = guarded.builder.data
    parser.StartDoctypeDeclHandler = guarded.doctype
    try:
        parser.Parse(text, True)
        return guarded.builder.close(), guarded.prefixed
    except expat.ExpatError as error:
        raise DefinitionError(f"the robot file is not XML: {error}") from error
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
        # The XML parser knew the encoding from the declaration or the first bytes.
        return ET.tostring(tree, encoding="unicode")


def elements(root: ET.Element) -> Iterator[tuple[str, ET.Element]]:
    """Yield each element of an XML tree, after a text that describes it in messages.

    The text has the tag and name of the element, or of its nearest named ancestor, such as "link `fore`".
    """
    stack = [(f"<{root.tag}>", root)]
    while stack:
        where, element = stack.pop()
        name = element.get("name")
        here = f"{element.tag} `{name}`" if name else where
        yield here, element
        stack.extend((here, child) for child in reversed(element))


def owner_at(text: str, tag: str, line: int) -> str:
    """Return a text for messages, such as "link `fore`", for the element that begins in a line; empty if there is none.

    - `text`: XML text.
    - `tag`: tag of the element.
    - `line`: number of the line, from 1.
    """
    parser, around, owners = expat.ParserCreate(), [""], [""]

    def start(name: str, attributes: dict[str, str]) -> None:
        own = attributes.get("name")
        around.append(f"{name} `{own}`" if own else around[-1])
        if parser.CurrentLineNumber == line and name == tag:
            owners.append(around[-1])

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: around.pop()
    parser.Parse(text, True)
    return owners[-1]


def _refuse_xacro(root: ET.Element) -> None:
    prefixes = tuple(f"{name[6:]}:" for name, value in root.attrib.items() if name[:6] == "xmlns:" and "xacro" in value)
    for where, element in elements(root):
        left = next((value for value in element.attrib.values() if "${" in value or "$(" in value), None)
        if left is None and element.tag.startswith(("xacro:", *prefixes)):
            left = "xacro:" + element.tag.rpartition(":")[2]
        if left is not None:
            renamed = ", or give the file a name that ends in .xacro" if root.tag == "robot" else ""
            raise DefinitionError(
                f"{where} still has xacro in it, `{left}`; run `xacro FILE > robot.urdf` first{renamed}"
            )


MOST_OF_A_MESH = 200 * MEGABYTE
FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Attributes of `<compiler>` that name folders."""

PARTS = ("include", "model")
"""Elements that name robot files."""


def require_named_files(root: ET.Element, folder: Path) -> None:
    """Check the files that a MuJoCo file and its included files name.

    Reading a pipe or a device would never end. Missing files are left to MuJoCo's reader, which searches other folders.

    Raises DefinitionError if a file exists but is not a regular file, or is too large.
    """
    waiting, known = [root], set[Path]()
    while waiting:
        element = waiting.pop()
        named = [text for compiler in element.iter("compiler") for text in _folders(compiler)]
        folders = {folder, *(folder / text for text in named)}
        for part in element.iter():
            name = part.get("file")
            for path in () if not name else (folder / name for folder in folders):
                if path in known or not _exists(path):
                    continue
                known.add(path)
                if part.tag in PARTS:
                    waiting += _parsed_part(path)
                else:
                    require_file(path, f"the file of <{part.tag}>", most=MOST_OF_A_MESH)


def _folders(compiler: ET.Element) -> list[str]:
    return [text for name in FOLDERS if (text := compiler.get(name))]


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _parsed_part(path: Path) -> list[ET.Element]:
    """Return the outermost element of an included file; empty if MuJoCo's reader will reject the file."""
    content = read_bytes(path, "the included file", most=MOST_BYTES)
    if b"<!DOCTYPE" in content:
        raise DefinitionError(f"the included file `{path}` has a DOCTYPE, which may define entities; remove it")
    try:
        return [ET.XML(content)]
    except (ET.ParseError, LookupError, ValueError):
        return []
