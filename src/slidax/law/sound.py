"""Check of a user's own law before it is simulated or exported."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax.codegen.trace.tracing import located_tracing_errors
from slidax.core.errors import DefinitionError, is_traced
from slidax.core.types import Command, Reference, State

from .controllers import AbstractController

PACKAGE = __name__.partition(".")[0]


def require_sound_law(controller: AbstractController) -> None:
    """Check the laws in a controller that users have defined outside this package.

    A law must be traceable by JAX, and its command must have the required form.

    Raises DefinitionError with the file, the line, the rule and the remedy.
    """
    for law in jax.tree.leaves(controller, is_leaf=_is_own):
        if _is_own(law):
            shapes = tuple((np.shape(leaf), str(getattr(leaf, "dtype", ""))) for leaf in jax.tree.leaves(law))
            _require(_Key(type(law), jax.tree.structure(law), shapes, law))


def _is_own(part: Any) -> bool:
    return isinstance(part, AbstractController) and type(part).__module__.partition(".")[0] != PACKAGE


@dataclass(frozen=True)
class _Key:
    """Key of the cache of checks: laws that differ in their numbers alone have equal keys."""

    kind: type[AbstractController]
    tree: Any
    shapes: tuple[Any, ...]
    law: AbstractController = field(compare=False)


@functools.lru_cache(64)
def _require(key: _Key) -> None:
    law, kind = key.law, key.kind
    n = law.joints
    t, vector = jnp.zeros(()), jnp.zeros(n)
    state, reference = State(vector, vector), Reference(vector, vector, vector)
    memory = _traced(law.init, t, state, reference)[1]
    _require_arrays(memory, "the memory", f"{_place(kind.init)}, in `{kind.__name__}.init`")
    where = f"{_place(kind.__call__)}, in `{kind.__name__}.__call__`"
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), memory)
    text, command = _traced(law, t, state, reference, reference, shapes)
    if not isinstance(command, Command):
        raise DefinitionError(
            f"{where}: a law must return `Command(tau=..., memory=memory, signals={{}})`; got "
            + ("nothing: the `return` is missing" if command is None else _kind(command))
        )
    if not hasattr(command.tau, "dtype") or command.tau.shape != (n,):
        got = f"shape {list(command.tau.shape)}" if hasattr(command.tau, "shape") else _kind(command.tau)
        raise DefinitionError(f"{where}: `tau` must be an array of {n} torques, one per joint; got {got}")
    for after in (command.memory,) if command.rate is None else (command.memory, command.rate):
        _require_arrays(after, "the memory", where)
        before, later = (jax.tree.map(lambda x: (x.shape, x.dtype.name), tree) for tree in (memory, after))
        if before != later:
            raise DefinitionError(
                f"{where}: the memory, and its `rate` if there is one, must keep the form that `init` gives the "
                f"memory, {_form(memory)}; got {_form(after)}: return the same arrays with the same shapes and types "
                "from `init` and `__call__`"
            )
    for name, value in command.signals.items() if isinstance(command.signals, dict) else [("", command.signals)]:
        _require_arrays(value, f"the signal `{name}`" if name else "`signals`, a dictionary of arrays,", where)
    if not text or _traced(law, t, state, reference, reference, shapes)[0] != text:
        raise DefinitionError(
            f"{where}: the law depends on a Python value that changes from call to call, such as a random number or a "
            "list, but a compiled law keeps its first value: take random numbers from `jax.random` with a key in the "
            "memory, and keep all other changing values in the memory"
        )


def _traced(function: Callable[..., Any], *arguments: Any) -> tuple[str, Any]:
    """Return a function's traced program as text with its constants, and its result.

    The text is empty if the program uses an array of another trace.
    """
    results = []

    def run(*arguments: Any) -> Any:
        results.append(function(*arguments))
        return [leaf for leaf in jax.tree.leaves(results[-1]) if hasattr(leaf, "dtype")]

    with located_tracing_errors():
        closed = jax.make_jaxpr(run)(*arguments)
    known = [number for number in closed.consts if not is_traced(number)]
    if len(known) < len(closed.consts) and not is_traced(function):
        return "", results[-1]
    return f"{closed.jaxpr} {[np.asarray(number).tobytes() for number in known]}", results[-1]


def _require_arrays(tree: Any, what: str, where: str) -> None:
    for leaf in jax.tree.leaves(tree):
        if not hasattr(leaf, "dtype"):
            raise DefinitionError(
                f"{where}: {what} must be made of arrays of numbers; got {leaf!r}, {_kind(leaf)}"
                + (f": write `jnp.asarray({leaf!r})`" if isinstance(leaf, bool | int | float) else "")
            )


def _form(tree: Any) -> str:
    leaves = [f"{leaf.dtype.name}{list(leaf.shape)}" for leaf in jax.tree.leaves(tree)]
    return ", ".join(leaves) or "nothing"


def _kind(thing: Any) -> str:
    return "an array" if hasattr(thing, "dtype") else f"a {type(thing).__name__}"


def _place(function: Any) -> str:
    code = inspect.unwrap(function).__code__
    return f"line {code.co_firstlineno} of {code.co_filename}"
