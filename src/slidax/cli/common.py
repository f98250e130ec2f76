"""Options, set-up, one-line errors, exit codes and output, common to all commands."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from pathlib import Path
from typing import IO, Annotated, Any

import typer


def complete_scenarios(incomplete: str) -> list[str]:
    """Built-in scenarios and YAML files that begin with the `incomplete` word, for the shell."""
    from importlib.resources import files

    built_in = [
        Path(entry.name).stem
        for entry in (files("slidax.scenarios") / "built_in").iterdir()
        if entry.name.endswith(".yaml")
    ]
    own = [str(path) for path in Path().glob("*.y*ml")]
    return sorted(name for name in built_in + own if name.startswith(incomplete))


Named = Annotated[
    str, typer.Argument(help="A built-in scenario by name, or a YAML file.", autocompletion=complete_scenarios)
]

Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Set a field of the scenario to a YAML value; repeatable."),
]

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]

Engine = StrEnum("Engine", ["auto", "native", "xla", "cuda"])
"""Engines that compute a run."""

Tip = Annotated[str | None, typer.Option(help="Link, body or site of the tip, if a file has several ends.")]

Gravity = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="Gravity in the base frame [m/s²], for an arm on a wall or ceiling.")
]

Inertias = Annotated[
    str | None,
    typer.Option(help="Physically impossible inertias in the file: `nearest` replaces, `strict` refuses them."),
]

Locked = Annotated[
    list[str] | None,
    typer.Option(metavar="JOINT=POSITION", help="Lock a joint of the file [rad or m]; repeatable."),
]


def named_arm(
    robot: str, tip: str | None, inertias: str | None, locked: list[str] | None, gravity: str | None
) -> tuple[Any, dict[str, Any]]:
    """Return the arm that a command's options select, and its description as under `robot` in a scenario.

    - `robot`: a built-in arm's name, or a file.
    - `tip`, `inertias`, `locked`, `gravity`: values of the options, as their help texts describe them.

    Raises DefinitionError if there is no such arm, or an option does not fit it.
    """
    from slidax.scenarios.named_robot import named_robot

    return named_robot(
        robot,
        tip=tip,
        inertias=inertias,
        locked=positions("--locked", locked or []),
        gravity=None if gravity is None else numbers("--gravity", gravity),
    )


def numbers(option: str, text: str) -> list[float]:
    """Return the comma-separated numbers in the `text` of an option.

    - `option`: the option, such as "--gravity", for the message.

    Raises DefinitionError if one is not a number.
    """
    from slidax.core.errors import DefinitionError, parse_number, short_repr

    try:
        return [parse_number(word) for word in text.split(",")]
    except ValueError:
        raise DefinitionError(
            f"`{option}` needs comma-separated numbers, such as 1,-1,1; got {short_repr(text)}"
        ) from None


def positions(option: str, texts: list[str]) -> dict[str, float]:
    """Return joint positions [rad or m] by joint name, from `texts` of the form JOINT=POSITION.

    - `option`: the option, such as "--locked", for the message.

    Raises DefinitionError for another form, or if a joint has two positions.
    """
    from slidax.core.errors import DefinitionError, parse_number, plain_name, short_repr

    places: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            position = parse_number(value)
        except ValueError:
            raise DefinitionError(
                f"`{option}` needs the form JOINT=POSITION, such as finger=0.04; got {short_repr(text)}"
            ) from None
        if places.setdefault(name.strip(), position) != position:
            raise DefinitionError(
                f"`{option}` names joint `{plain_name(name.strip())}` twice, with different positions"
            )
    return places


DEFINITION, OUTCOME, INTERRUPTED = 2, 3, 130
"""Exit codes: an invalid request; a run that ended badly; Ctrl-C, as in a shell."""


def prepare() -> None:
    """Enable 64-bit numbers and the compilation cache of JAX for this process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if jax.config.jax_compilation_cache_dir is None:
        # Compilation takes most of the time of a short run, so all programs are cached, also small ones.
        jax.config.update("jax_compilation_cache_dir", str(_compiled()))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _compiled() -> Path:
    """Return the cache folder for programs compiled by this version of JAX."""
    import jax
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / f"xla-{jax.__version__}"


@contextmanager
def errors_as_lines() -> Iterator[None]:
    """Turn a DefinitionError into one line and exit code 2, Ctrl-C into 130, and print each warning as one line."""
    from slidax.core.errors import DefinitionError

    try:
        with warnings.catch_warnings():
            warnings.showwarning = _Warnings().show
            yield
    except DefinitionError as error:
        _say(str(error))
        raise typer.Exit(DEFINITION) from None
    except KeyboardInterrupt:
        _say("interrupted: the same command starts again from the beginning")
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        # The reader closed the pipe, as in `slidax list | head`.
        sys.stderr.close()
        raise typer.Exit(0) from None
    except OSError as error:
        # Raised by writing; readers raise DefinitionError.
        _say(_cannot_write(error))
        raise typer.Exit(DEFINITION) from None
    except (MemoryError, RecursionError) as error:
        _say(f"too large to compute on this machine ({type(error).__name__}): use a smaller input")
        raise typer.Exit(DEFINITION) from None
    except BaseException as error:
        # A panic of a Rust library; its class derives from BaseException alone.
        if type(error).__name__ != "PanicException":
            raise
        reason = str(error).partition("\n")[0]
        _say(f"a library crashed ({reason}): unless the disk is full, please report this command")
        raise typer.Exit(DEFINITION) from None


def _cannot_write(error: OSError) -> str:
    from slidax.core.writing import NO_ROOM, error_reason

    if error.filename:
        return f"cannot write `{os.fsdecode(error.filename)}`: {error_reason(error)}"
    return f"cannot write the output: {error_reason(error)}" if error.errno in NO_ROOM else error_reason(error)


def _unbroken(span: re.Match[str]) -> str:
    return span[0].replace(" ", "\N{NO-BREAK SPACE}")


def _say(message: str) -> None:
    """Print a message on standard error, after `slidax:`; unprintable characters are escaped."""
    say(f"slidax: {''.join(c if c.isprintable() else ascii(c)[1:-1] for c in message)}", err=True)


def say(text: str, *, err: bool = False, margin: str = "", hang: int = 0) -> None:
    """Print a `text`, wrapped by words to the terminal's width; without a terminal, on one line.

    - `err`: True for standard error.
    - `margin`: before each line.
    - `hang`: further spaces before each line but the first.
    """
    typer.echo(wrapped(text, columns(sys.stderr if err else sys.stdout), margin, hang), err=err)


def columns(stream: IO[str]) -> int | None:
    """Return the line width of a `stream` [characters]: COLUMNS, or the terminal's width; None for a pipe."""
    if "COLUMNS" not in os.environ and not stream.isatty():
        return None
    return shutil.get_terminal_size().columns


def wrapped(text: str, width: int | None, margin: str = "", hang: int = 0) -> str:
    """Return the `text` wrapped to a `width`. Commands in backticks, and numbers with their units, are not broken.

    - `margin`, `hang`: as in `say`.
    """
    if width is None:
        return margin + text
    # textwrap does not break at a no-break space.
    joined = re.sub(r"`[^`\n]*`|\d (?:%|[kmµ]?(?:rad|g|m|s|N|Hz|W)\b)(?: m\b)?", _unbroken, text)
    lines = textwrap.fill(
        joined,
        width,
        initial_indent=margin,
        subsequent_indent=margin + hang * " ",
        break_on_hyphens=False,
        break_long_words=False,
    )
    return lines.replace("\N{NO-BREAK SPACE}", " ")


def say_warning(message: str) -> None:
    """Print a `message` about a possible problem; the command continues."""
    _say(f"warning: {message}")


def say_note(message: str) -> None:
    """Print a `message` about an automatic choice, such as a joint that is left out."""
    _say(f"note: {message}")


class _Warnings:
    """Shows each warning of Python as one line, without its file and line number."""

    def __init__(self) -> None:
        self._cache_reported = False

    def show(self, message: Warning | str, *_: Any, **__: Any) -> None:
        """Print a warning `message`."""
        import jax

        text, folder = str(message), _compiled()
        if "persistent compilation cache entry" not in text or jax.config.jax_compilation_cache_dir != str(folder):
            say_warning(text)
        elif text.startswith("Error reading"):
            # A full disk or a kill leaves incomplete files, which JAX would not replace.
            for path in folder.glob("*-cache"):
                with suppress(OSError):
                    path.unlink()
        elif not self._cache_reported:
            self._cache_reported = True
            reason = text.partition("': ")[2].partition("\n")[0]
            say_warning(f"cannot cache compiled programs in `{folder}` ({reason}): the next command compiles again")


@contextmanager
def stage_bar() -> Iterator[Callable[[str, int], None]]:
    """Show a progress bar on a terminal, with the time left as estimated from the finished stages.

    Yields the function to call when a stage begins, with the stage's name and the number of all stages.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("compiling", total=None)
        begun = 0

        def begin(name: str, total: int) -> None:
            nonlocal begun
            bar.update(task, description=name, completed=begun, total=total)
            begun += 1

        yield begin


def parse_changes(changes: list[str]) -> dict[str, Any]:
    """Return the values of `--set` by dotted path, from `changes` of the form PATH=VALUE.

    Raises DefinitionError for another form.
    """
    from slidax.core.errors import DefinitionError
    from slidax.scenarios.yaml_text import read_yaml

    values: dict[str, Any] = {}
    for change in changes:
        path, sign, value = change.partition("=")
        if not sign or not path.strip():
            raise DefinitionError(f"`--set {change}` needs the form PATH=VALUE, such as disturbance.scale=0")
        values[path.strip()] = read_yaml(value)
    return values


def command_line() -> str:
    """Return the command as the user typed it, for reports."""
    return shlex.join(["slidax", *sys.argv[1:]])


def say_where(out: Path) -> None:
    """Print the path of the report in the folder `out`."""
    typer.echo(f"The report is in {out.resolve() / 'report.html'}")


def print_json(value: dict[str, Any]) -> None:
    """Print `value` as a JSON object."""
    import json

    # A NaN here is a fault of slidax; a traceback is better than invalid JSON.
    typer.echo(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False))
