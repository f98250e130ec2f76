"""What every command does around its own work: settings, errors as lines, exit codes, output."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import typer

DEFINITION, OUTCOME = 2, 3
"""Exit codes: an invalid request; a run that ended badly."""


def prepare() -> None:
    """Switches 64-bit numbers and a compilation cache on, as the command line may: the process is its own."""
    import jax

    jax.config.update("jax_enable_x64", True)
    if jax.config.jax_compilation_cache_dir is None:
        # Compiling takes most of the time of a short run; the second then need not, not even many small programs.
        jax.config.update("jax_compilation_cache_dir", str(_compiled()))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _compiled() -> Path:
    """The folder of compiled programs, one for each version of JAX."""
    import jax
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / f"xla-{jax.__version__}"


@contextmanager
def errors_as_lines() -> Iterator[None]:
    """A DefinitionError becomes one line and exit code 2; a traceback would hide it. Warnings are lines, too."""
    from slidax._errors import DefinitionError

    try:
        with warnings.catch_warnings():
            warnings.showwarning = _Warnings().show
            yield
    except DefinitionError as error:
        _say(str(error))
        raise typer.Exit(DEFINITION) from None
    except BrokenPipeError:
        # The reader went away, as `slidax list | head` does: nothing is wrong.
        sys.stderr.close()
        raise typer.Exit(0) from None
    except OSError as error:
        # A folder or file to write: what is read says so itself.
        _say(_cannot_write(error))
        raise typer.Exit(DEFINITION) from None
    except (MemoryError, RecursionError) as error:
        _say(f"this is too large to compute here ({type(error).__name__}): use fewer or smaller parts")
        raise typer.Exit(DEFINITION) from None
    except BaseException as error:
        # A panic of a foreign library in Rust, which derives from nothing else.
        if type(error).__name__ != "PanicException":
            raise
        reason = str(error).partition("\n")[0]
        _say(f"a library failed in itself ({reason}): if the disk is not full, please report this command")
        raise typer.Exit(DEFINITION) from None


def _cannot_write(error: OSError) -> str:
    from slidax._writing import NO_ROOM, reason

    if error.filename:
        return f"cannot write `{os.fsdecode(error.filename)}`: {reason(error)}"
    return f"cannot write the output: {reason(error)}" if error.errno in NO_ROOM else reason(error)


def _say(message: str) -> None:
    """One line, whatever the names in it are."""
    typer.echo(f"slidax: {''.join(c if c.isprintable() else ascii(c)[1:-1] for c in message)}", err=True)


def say_warning(message: str) -> None:
    """One line about what may go wrong; the command goes on.

    - `message`: what is said.
    """
    _say(f"warning: {message}")


def say_note(message: str) -> None:
    """Print one line about what the command did by itself, such as a joint that it left out.

    - `message`: the sentence.
    """
    _say(f"note: {message}")


class _Warnings:
    """Warnings as lines, without the place in the code that they came from, which tells a user nothing."""

    def __init__(self) -> None:
        self._is_cache_told = False

    def show(self, message: Warning | str, *_: Any, **__: Any) -> None:
        """Print a warning.

        - `message`: the warning.
        """
        import jax

        text, folder = str(message), _compiled()
        if "persistent compilation cache entry" not in text or jax.config.jax_compilation_cache_dir != str(folder):
            say_warning(text)
        elif text.startswith("Error reading"):
            # JAX writes its files in place, so that a full disk or a kill leaves halves, which it would not replace.
            for path in folder.glob("*-cache"):
                with suppress(OSError):
                    path.unlink()
        elif not self._is_cache_told:
            self._is_cache_told = True
            reason = text.partition("': ")[2].partition("\n")[0]
            say_warning(f"compiled programs cannot be kept in `{folder}` ({reason}): the next command compiles again")


def parsed(changes: list[str]) -> dict[str, Any]:
    """The values of `--set` by their paths.

    - `changes`: each as PATH=VALUE.

    Raises DefinitionError if one has another form.
    """
    from slidax._errors import DefinitionError
    from slidax.scenarios.yaml_text import read_yaml

    parsed: dict[str, Any] = {}
    for change in changes:
        path, sign, value = change.partition("=")
        if not sign or not path.strip():
            raise DefinitionError(f"`--set {change}` needs the form PATH=VALUE, such as disturbance.scale=0")
        parsed[path.strip()] = read_yaml(value)
    return parsed


def say_where(out: Path) -> None:
    """Says where a report is.

    - `out`: its folder.
    """
    typer.echo(f"The report is in {out.resolve() / 'report.html'}")


def print_json(value: dict[str, Any]) -> None:
    """Prints one object.

    - `value`: the object.
    """
    import json

    # allow_nan=False: a NaN here would be our own fault; a traceback is better than invalid JSON.
    typer.echo(json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False))
