"""URDF files that are written as xacro macros, expanded by xacrodoc without running code of theirs."""

from __future__ import annotations

import contextlib
import io
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.dom import minidom

from slidax._errors import DefinitionError
from slidax._files import open_file

from .expression import ExpressionError, evaluate
from .meshes import Packages

MISSING = "xacrodoc, which reads xacro files, is needed: pip install 'slidax[robots]'"

_ONE_AT_A_TIME = threading.Lock()
"""xacro keeps the file that it reads in variables of its module."""


def expand(path: Path, arguments: Mapping[str, str], packages: Packages = ()) -> str:
    """Return the URDF text of a xacro file.

    Its expressions are evaluated by `expression.evaluate`, so that a file cannot run code; it may include and read
    other files, by relative paths and by `$(find PACKAGE)`. A package is looked for in `packages`, around the file, and
    where ROS has it.

    - `path`: of the file.
    - `arguments`: values of its `<xacro:arg>` by name.
    - `packages`: as of `from_urdf`.

    Raises DefinitionError if xacrodoc is not installed, or the file cannot be expanded.
    """
    try:
        import xacro
        import xacrodoc
        from xacro import substitution_args
        from xacrodoc import packages as ros
    except ImportError as error:
        raise DefinitionError(MISSING) from error
    with open_file(path, "the robot file") as file:
        text = file.read().decode("utf-8", "replace")
    functions = _functions(xacro)

    def expression(words: str, names: Any, local: Any = None) -> Any:
        return evaluate(words, names, functions)

    def substitution(words: str, context: Mapping[str, Any]) -> str:
        given = {name: substitution_args.convert_value(one, "auto") for name, one in context.get("arg", {}).items()}
        arg: dict[str, Callable[..., Any]] = {"arg": lambda name: given[name]}
        return str(evaluate(words, {**functions, **given, **arg}, {**functions, **arg}))

    def parse(source: Any, filename: str | None = None) -> Any:
        if source is None:
            source = _content(Path(xacro.root_dir, str(filename)))
        if not isinstance(source, str | bytes):
            return source
        if "<!DOCTYPE" in (source if isinstance(source, str) else source.decode("utf-8", "replace")):
            raise DefinitionError("it has a DOCTYPE, which may define entities; remove it")
        return minidom.parseString(source)

    def find(package: str) -> str:
        found = _package(package, path, packages)
        try:
            return found or str(ros.get_path(package))
        except Exception:
            raise DefinitionError(
                f"package `{package}` is not found; packages={{'{package}': FOLDER}} says where it is"
            ) from None

    swaps = (
        (xacro, "safe_eval", expression),
        (xacro, "parse", parse),
        (substitution_args, "_eval", substitution),
        (substitution_args, "_eval_find", find),
    )
    with _ONE_AT_A_TIME, _replaced(swaps), contextlib.redirect_stderr(io.StringIO()), contextlib.ExitStack() as left:
        left.callback(xacro.init_stacks, None)
        xacro.init_stacks(str(path))
        try:
            document = xacrodoc.XacroDoc.from_string(text, subargs=dict(arguments), resolve_packages=False)
            expanded: str = document.dom.toxml()
        except Exception as error:
            raise DefinitionError(f"xacro does not expand the robot file `{path}`: {_one_line(error)}") from error
    return expanded


def _one_line(error: BaseException) -> str:
    """The message, with that of the error behind it, without line ends."""
    inner = getattr(error, "exc", None)
    text = str(error) or (str(inner) if inner else "") or type(error).__name__
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())


@contextlib.contextmanager
def _replaced(swaps: tuple[tuple[Any, str, Any], ...]) -> Iterator[None]:
    """While a file is expanded: what would run Python's evaluator, or open any file, is our own.

    Raises DefinitionError if a version of xacro has none of that name, and so may evaluate in another way.
    """
    for module, name, _ in swaps:
        if not callable(getattr(module, name, None)):
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
    def message(*words: Any, **_: Any) -> str:
        return ""

    def fatal(*words: Any) -> None:
        raise ExpressionError(" ".join(map(str, words)))

    def load_yaml(name: str) -> Any:
        return _yaml(Path(xacro.abs_filename_spec(str(name))))

    return {
        "load_yaml": load_yaml,
        "abs_filename": lambda name: xacro.abs_filename_spec(str(name)),
        "dotify": dict,
        "arg": lambda name: xacro.substitution_args_context["arg"][name],
        "tokenize": lambda text, sep=",; ", skip_empty=True: xacro.tokenize(str(text), sep, skip_empty),
        "fatal": fatal,
        **dict.fromkeys(("message", "warning", "error", "print_location"), message),
    }


def _content(path: Path) -> bytes:
    with open_file(path, "the included file") as file:
        return file.read()


def _yaml(path: Path) -> Any:
    """A YAML file of plain data, with the units of xacro."""
    import yaml

    factors = {"radians": 1.0, "degrees": math.pi / 180.0, "meters": 1.0, "millimeters": 1e-3}
    factors |= {"foot": 0.3048, "inches": 0.0254}

    # A class of its own, as the constructors would be those of every reader of YAML.
    loader: Any = type("Loader", (yaml.SafeLoader,), {})

    def scaled(factor: float) -> Callable[[Any, Any], float]:
        return lambda loader, node: factor * float(evaluate(loader.construct_scalar(node), vars(math), {}))

    for unit, factor in factors.items():
        loader.add_constructor(f"!{unit}", scaled(factor))
    return yaml.load(_content(path), loader)


def _package(name: str, path: Path, packages: Packages) -> str | None:
    """The folder of a package: a given one, or one of this name around the file."""
    if isinstance(packages, Mapping):
        places = [Path(packages[name])] if name in packages else []
    else:
        places = [Path(place) / name for place in packages]
    for above in path.resolve().parents:
        places += [above] if above.name == name else []
        places += [above / name]
    return next((str(place) for place in places if place.is_dir()), None)
