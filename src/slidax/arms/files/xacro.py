"""Expand xacro files to URDF by xacrodoc, without running code from the file."""

from __future__ import annotations

import contextlib
import io
import math
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.dom import minidom

from slidax.core.errors import DefinitionError, short_repr
from slidax.core.files import MEGABYTE, read_bytes

from .expression import CHARACTERS, Budget, ExpressionError, evaluate
from .reading import Packages

MISSING = "xacrodoc, which reads xacro files, is needed: pip install 'slidax[robots]'"

MOST_OF_YAML = MEGABYTE // 4
"""Size limit of a YAML file [bytes]; reading a larger one can take more than ten seconds."""

STEPS_OF_A_NODE = 25
"""Steps that an element or an attribute takes from the `Budget`, to limit an expansion to about 0.2 GB of memory."""

STEPS_OF_A_COPY = 100
"""Additional steps that each use of a macro or a block takes from the `Budget`."""

LONGEST_MESSAGE = 500
"""Most characters of a message from xacro that an error shows."""

MACRO_PARAMETER = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'[^']*'|\"[^\"]*\"|[^\s'\"])+|)(?:\s+|$)(.*)"
)
"""xacro's own regular expression, without a nested repetition that can take exponential time."""

_ONE_AT_A_TIME = threading.Lock()
"""Lock for xacro, which keeps the state of an expansion in module variables."""


def expand(path: Path, arguments: Mapping[str, str], packages: Packages = (), *, most: int) -> str:
    """Return the URDF text of a xacro file.

    `expression.evaluate` evaluates its expressions, so a file cannot run code. It may include and read other files, by
    relative paths and by `$(find PACKAGE)`. Packages are searched in `packages`, in the folders above the file, and
    where ROS has them.

    - `arguments`: values of its `<xacro:arg>` by name.
    - `most`: size limit for the file, for each included file, and for the expansion [bytes].

    Raises DefinitionError if xacrodoc is not installed, xacro rejects the file, or the expansion needs more bytes than
    `most` or more steps than a `Budget` has.
    """
    try:
        import xacro
        import xacrodoc
        from xacro import substitution_args
        from xacrodoc import packages as ros
    except ImportError as error:
        raise DefinitionError(MISSING) from error
    text = read_bytes(path, "the robot file", most=most).decode("utf-8", "replace")
    functions, budget = _functions(xacro), Budget()
    original_eval_all, original_eval_text = xacro.eval_all, xacro.eval_text

    def expression(words: str, names: Any, local: Any = None) -> Any:
        return evaluate(words, names, functions, budget)

    def substitution(words: str, context: Mapping[str, Any]) -> str:
        values = {name: substitution_args.convert_value(word, "auto") for name, word in context.get("arg", {}).items()}
        arg: dict[str, Callable[..., Any]] = {"arg": lambda name: values[name]}
        return str(evaluate(words, {**functions, **values, **arg}, {**functions, **arg}, budget))

    def eval_text(words: str, symbols: Any) -> Any:
        # xacro's lexer copies the rest of the string at each `$`.
        budget.spend(1 + len(words) // CHARACTERS + words.count("$") * len(words) // CHARACTERS**2)
        return original_eval_text(words, symbols)

    def eval_all(node: Any, macros: Any, symbols: Any) -> None:
        if node.parentNode is None:
            # A copy of a macro or a block: count all its nodes before it copies others in turn.
            budget.spend(STEPS_OF_A_COPY + STEPS_OF_A_NODE * _nodes_in(node))
        original_eval_all(node, macros, symbols)

    def parse(source: Any, filename: str | None = None) -> Any:
        if source is None:
            source = read_bytes(Path(xacro.root_dir, str(filename)), "the included file", most=most)
        if not isinstance(source, str | bytes):
            return source
        source = source.encode() if isinstance(source, str) else source
        if b"<!DOCTYPE" in source:
            raise DefinitionError("it has a DOCTYPE, which may define entities; remove it")
        budget.spend(STEPS_OF_A_NODE * sum(map(source.count, (b"</", b"/>", b"="))))
        return minidom.parseString(source)

    def find(package: str) -> str:
        try:
            return _package(package, path, packages) or str(ros.get_path(package))
        except Exception:
            raise DefinitionError(
                f"package `{package}` is not found; packages={{'{package}': FOLDER}} says where it is"
            ) from None

    swaps = (
        (xacro, "safe_eval", expression),
        (xacro, "eval_text", eval_text),
        (xacro, "eval_all", eval_all),
        (xacro, "re_macro_arg", MACRO_PARAMETER),
        (xacro, "parse", parse),
        (substitution_args, "_eval", substitution),
        (substitution_args, "_eval_find", find),
    )
    with (
        _ONE_AT_A_TIME,
        _replace_attributes(swaps),
        contextlib.redirect_stderr(io.StringIO()),
        contextlib.ExitStack() as left,
    ):
        left.callback(xacro.init_stacks, None)
        xacro.init_stacks(str(path))
        try:
            document = xacrodoc.XacroDoc.from_string(text, subargs=dict(arguments), resolve_packages=False)
            expansion = _LimitedText(most)
            document.dom.writexml(expansion)
        except Exception as error:
            raise DefinitionError(f"xacro does not expand the robot file `{path}`: {_one_line(error)}") from error
    return expansion.getvalue()


class _LimitedText(io.StringIO):
    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def write(self, text: str) -> int:
        if self.tell() + len(text) > self.most:
            raise ExpressionError(f"its expansion has more than {self.most / MEGABYTE:g} MB")
        return super().write(text)


def _nodes_in(element: Any) -> int:
    """Return the number of elements and attributes in an element, including itself."""
    number, waiting = 0, [element]
    while waiting:
        node = waiting.pop()
        number += 1 + (len(node.attributes) if node.attributes else 0)
        waiting.extend(child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE)
    return number


def _one_line(error: Exception) -> str:
    """Return the message of an error, or of its cause, on one line."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, RecursionError):
            return "macros, includes, properties or elements are nested too deeply; does one of them contain itself?"
        cause = cause.__context__
    inner = getattr(error, "exc", None)
    text = str(error) or (str(inner) if inner else "") or type(error).__name__
    text = "; ".join(line.strip() for line in text.splitlines() if line.strip())
    return text if len(text) <= LONGEST_MESSAGE else f"{text[:LONGEST_MESSAGE]}..."


@contextlib.contextmanager
def _replace_attributes(swaps: tuple[tuple[Any, str, Any], ...]) -> Iterator[None]:
    """Replace evaluation, file access and limits in xacro's modules by slidax's own, for one expansion.

    Raises DefinitionError if a version of xacro lacks one of the names, since it may evaluate expressions differently.
    """
    for module, name, _ in swaps:
        if not hasattr(module, name):
            raise DefinitionError(
                f"this version of xacro has no `{module.__name__}.{name}`, so that its expressions could run code; "
                "install another, or expand the file yourself by `xacro FILE > robot.urdf`"
            )
    before = [(module, name, getattr(module, name)) for module, name, _ in swaps]
    try:
        for module, name, own in swaps:
            setattr(module, name, own)
        yield
    finally:
        for module, name, old in before:
            setattr(module, name, old)


def _functions(xacro: Any) -> dict[str, Callable[..., Any]]:
    def message(*words: Any, **options: Any) -> str:
        return ""

    def fatal(*words: Any) -> None:
        raise ExpressionError(" ".join(word if isinstance(word, str) else short_repr(word) for word in words))

    def load_yaml(name: str) -> Any:
        return _yaml(Path(xacro.abs_filename_spec(str(name))))

    return {
        "load_yaml": load_yaml,
        "abs_filename": lambda name: xacro.abs_filename_spec(str(name)),
        "dotify": dict,
        "arg": lambda name: xacro.substitution_args_context["arg"][name],
        # xacro would use the separators as a regular expression.
        "tokenize": lambda text, sep=",; ", skip_empty=True: xacro.tokenize(str(text), re.escape(sep), skip_empty),
        "fatal": fatal,
        **dict.fromkeys(("message", "warning", "error", "print_location"), message),
    }


def _yaml(path: Path) -> Any:
    """Read a YAML file of plain data, with xacro's units."""
    import yaml

    factors = {"radians": 1.0, "degrees": math.pi / 180.0, "meters": 1.0, "millimeters": 1e-3}
    factors |= {"foot": 0.3048, "inches": 0.0254}
    # A new class, since constructors added to SafeLoader would apply to every reader of YAML.
    loader: Any = type("Loader", (yaml.SafeLoader,), {})

    def scaled(factor: float) -> Callable[[Any, Any], float]:
        return lambda loader, node: factor * float(evaluate(loader.construct_scalar(node), vars(math), {}))

    for unit, factor in factors.items():
        loader.add_constructor(f"!{unit}", scaled(factor))
    return yaml.load(read_bytes(path, "the YAML file", most=MOST_OF_YAML), loader)


def _package(name: str, path: Path, packages: Packages) -> str | None:
    """Return the folder of a package: from `packages`, or a folder with its name above the file."""
    if isinstance(packages, Mapping):
        folders = [Path(packages[name])] if name in packages else []
    else:
        folders = [Path(folder) / name for folder in packages]
    for above in path.resolve().parents:
        folders += [above] if above.name == name else []
        folders += [above / name]
    return next((str(folder) for folder in folders if folder.is_dir()), None)
