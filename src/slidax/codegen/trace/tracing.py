"""Trace a JAX function to a program of the intermediate representation (IR), with the source location of each value.

A primitive is an operation of JAX. A jaxpr is JAX's list of the primitives in a function, one equation for each.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import os
import sysconfig
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import CodeType
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.errors import UnexpectedTracerError
from jax.extend.core import ClosedJaxpr  # type: ignore[attr-defined]

from slidax.core.errors import DefinitionError

from ..builder import Builder, Values
from ..ir import NoNativeCodeError, Program, as_native_code_error
from . import array_primitives, control_flow, elementwise
from . import elementwise as random
from .arrays import Inline, constant_array, type_of
from .control_flow import expand, linear_solve, platform_index
from .library import Library, keep_array

HERE = os.path.dirname(__file__)
OURS = os.path.dirname(os.path.dirname(HERE)), os.path.dirname(np.__file__)
"""Folders of slidax and NumPy, whose code is not the user's."""

STANDARD, INSTALLED = sysconfig.get_path("stdlib"), (sysconfig.get_path("purelib"), sysconfig.get_path("platlib"))
"""Folder of the standard library, and folders of installed packages, which may be inside it."""

LIBRARIES = tuple(f"{os.sep}{name}{os.sep}" for name in ("jax", "equinox", "jaxtyping", "beartype"))


class SourceFrame(NamedTuple):
    """An expression in a source file.

    - `file`, `line`: start of the expression.
    - `function`: qualified name of the surrounding function.
    - `column`, `end_line`, `end_column`: start and end within the lines, in bytes as `ast` counts them.
    """

    file: str
    line: int
    function: str
    column: int = 0
    end_line: int = 0
    end_column: int = 0


@dataclass(slots=True, eq=False)
class Origin:
    """Source location of an IR value.

    - `equation`: the equation of the jaxpr that computes it.
    - `element`: index of the value in the equation's result, in C order; None for an intermediate value.
    - `shape`: shape of that result.
    - `within`: name of the function whose callers `frames` excludes; None to include all callers.
    - `visit`: a key, the same object for all values of one operation on arrays.
    """

    equation: Any
    element: int | None = None
    shape: tuple[int, ...] = ()
    within: str | None = None
    visit: object = None

    def __post_init__(self) -> None:
        self.visit = self.visit or self

    @property
    def frames(self) -> list[SourceFrame]:
        """Source locations, the innermost first, without JAX and its libraries."""
        frames = frames_of(self.equation)
        for k, frame in enumerate(frames):
            if self.within is not None and frame.function.rpartition(".")[2] == self.within:
                return frames[: k + 1]
        return frames


def frames_of(equation: Any) -> list[SourceFrame]:
    """Return the source locations of a jaxpr's equation, the innermost first, without JAX and its libraries."""
    traceback = equation.source_info.traceback
    frames: list[SourceFrame] = []
    for code, instruction in zip(*traceback.raw_frames(), strict=True) if traceback is not None else ():
        if code.co_filename.startswith(HERE):
            # Callers of the tracer do not belong to the traced function.
            break
        if _is_user_code(code.co_filename):
            frames.append(_frame(code, instruction))
    return frames


@functools.lru_cache(10_000)
def _frame(code: CodeType, instruction: int) -> SourceFrame:
    positions = next(itertools.islice(code.co_positions(), instruction // 2, None))
    line, end_line, column, end_column = (number or 0 for number in positions)
    return SourceFrame(code.co_filename, line, code.co_qualname, column, end_line, end_column)


@functools.cache
def _is_user_code(file: str) -> bool:
    inside = os.path.dirname(os.path.dirname(jax.__file__))
    if file.startswith(inside) and any(name in file[len(inside) :] for name in LIBRARIES):
        return False
    return not file.startswith("<frozen")


def _is_own(file: str) -> bool:
    """True for the user's code: all files except those of slidax, NumPy and the standard library."""
    standard = file.startswith(STANDARD) and not file.startswith(INSTALLED)
    return not (standard or file.startswith(OURS))


CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "eval_jaxpr": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
    "remat2": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
"""Primitives that call another jaxpr, and the name of the parameter with this jaxpr."""

PLAIN: dict[str, Callable[[Builder, Any, list[Values]], Values | list[Values]]] = {
    **elementwise.ELEMENTWISE_RULES,
    **array_primitives.SHAPE_RULES,
    **array_primitives.REDUCTION_RULES,
    **array_primitives.INDEXING_RULES,
    "threefry2x32": random.threefry,
    "iota_2x32_shape": random.counters,
    "platform_index": platform_index,
    "random_wrap": random.key_words,
    "random_unwrap": random.key_words,
}
"""Rule of each primitive that contains no jaxpr."""

WITH_JAXPRS: dict[str, Callable[[Builder, Any, list[Values], Inline], list[Values]]] = {
    "while": control_flow.while_loop,
    "scan": control_flow.scan,
    "cond": control_flow.cond,
    "call_hi_primitive": expand,
    "custom_linear_solve": linear_solve,
    "linear_solve": linear_solve,
    "random_seed": random.inline_generator("seed"),
    "random_fold_in": random.inline_generator("fold_in"),
    "random_bits": random.inline_generator("random_bits"),
    "random_split": random.inline_generator("split"),
}
"""Rule of each primitive that contains or expands into another jaxpr."""

REMEDIES = {
    "sort": "write it with `jnp.max`, `jnp.min` or `jnp.argmax`",
    "top_k": "write it with `jnp.max` or `jnp.argmax`",
    "cholesky": "use `slidax.core.solve_symmetric`",
    "triangular_solve": "use `slidax.core.solve_symmetric`",
    "lu": "use `slidax.core.solve_symmetric`",
    "eigh": "use `slidax.core.linear_algebra`, or a closed form",
    "svd": "use `slidax.core.linear_algebra`, or a closed form",
    "qr": "use `slidax.core.solve_symmetric`",
    "pure_callback": "write it in `jax.numpy`",
    "io_callback": "write it in `jax.numpy`",
    "debug_callback": "remove the print",
}
"""Remedies for primitives without a rule."""


UNTRACEABLE: dict[type[Exception], tuple[str, str]] = {
    jax.errors.TracerBoolConversionError: (
        "an `if`, `while`, `and`, `or`, `not`, `min` or `max` of Python needs the value of an array",
        "write `jnp.where(condition, a, b)`, `jnp.minimum`, `jnp.maximum`, or `&`, `|` and `~` between conditions",
    ),
    jax.errors.TracerArrayConversionError: (
        "a NumPy function needs the values of an array",
        "call the function of the same name in `jax.numpy`, such as `jnp.tanh` for `np.tanh`",
    ),
    jax.errors.TracerIntegerConversionError: (
        "a Python list, tuple or range needs the value of an array as its index or length",
        "make it an array by `jnp.array`, and index that",
    ),
    jax.errors.NonConcreteBooleanIndexError: (
        "a mask selects a number of elements that depends on values",
        "keep the shape by `jnp.where(mask, x, 0.0)`",
    ),
    jax.errors.ConcretizationTypeError: (
        "`float`, `int` or a function of `math` needs the value of an array",
        "use the array itself, `x.astype(int)`, or `jax.numpy`, such as `jnp.sin` for `math.sin`",
    ),
}
"""Errors of JAX for code that depends on the values of arrays, subclasses first: what is wrong, and the remedy."""


OWN_MISTAKES: dict[type[Exception], str] = {
    dataclasses.FrozenInstanceError: "a law is immutable: keep varying values in its memory, and return the memory",
    UnexpectedTracerError: "an array was stored outside the law: return it in the law's memory",
}
"""Remedies for other exceptions in the user's code."""

IN_PLACE = "write `x = x.at[i].set(value)` for `x[i] = value`"


@contextmanager
def located_tracing_errors() -> Iterator[None]:
    """Convert errors while a `with` block traces a function to DefinitionErrors with line, rule and remedy.

    These are JAX's errors for code that depends on the values of arrays, and all errors raised in the user's own code.

    Raises DefinitionError.
    """
    try:
        yield
    except tuple(UNTRACEABLE) as error:
        wrong, remedy = next(words for kind, words in UNTRACEABLE.items() if isinstance(error, kind))
        raise DefinitionError(
            f"{_place_of(error)}{wrong}, but a law is traced once, before the values of its arrays are known: {remedy}"
        ) from error
    except DefinitionError:
        raise
    except Exception as error:
        place = _place_of(error, own=True)
        if not place:
            raise
        message = str(error).strip().partition("\n")[0].rstrip(".")
        remedy = next((words for kind, words in OWN_MISTAKES.items() if isinstance(error, kind)), "")
        if "item assignment" in message:
            message, remedy = "an array cannot be changed in place", IN_PLACE
        elif "__format__" in message:
            message = "a number is not known while the law is traced"
            remedy = "remove the print, or print by `jax.debug.print` in runs with XLA only"
        raise DefinitionError(f"{place}{type(error).__name__}: {message}{': ' if remedy else ''}{remedy}") from error


def _place_of(error: BaseException, *, own: bool = False) -> str:
    """Return the location of an exception: the innermost line of the user's code, or else of slidax and its libraries.

    - `own`: true for the user's code only. The text is empty if there is no such line.
    """
    places = {True: "", False: ""}
    trace_back = error.__traceback__
    while trace_back is not None:
        code = trace_back.tb_frame.f_code
        if _is_user_code(code.co_filename) and not code.co_filename.startswith(HERE):
            place = f"line {trace_back.tb_lineno} of {code.co_filename}, in `{code.co_qualname}`: "
            places[_is_own(code.co_filename)] = place
        trace_back = trace_back.tb_next
    return places[True] if own else places[True] or places[False]


def inline(
    builder: Builder,
    closed: Any,
    arrays: Sequence[Values],
    *,
    constants: Sequence[Values] | None = None,
    named: bool = False,
    library: Library | None = None,
) -> list[Values]:
    """Append the operations of a closed jaxpr (one with its constants) to a program; return its results.

    The results are arrays of IR values.

    - `builder`: builder of the program.
    - `arrays`: arguments of the jaxpr, as arrays of IR values.
    - `constants`: constants of the jaxpr, as arrays of IR values; None: the numbers stored in the jaxpr.
    - `named`: true to record the source location of each value, which takes time.
    - `library`: collects long functions under `jax.jit` as separate programs; None inlines all of them.

    Raises NoNativeCodeError, with name, source location and remedy, if a primitive has no rule or its rule fails.
    """
    return _Inlining(builder, named, library).run(closed, arrays, constants)


@dataclass
class _Inlining:
    """The work of `inline`, in progress; `builder`, `named` and `library` are its arguments.

    - `within`: name of the surrounding function; origins exclude its callers.
    - `call`: inside a called function, the equation of the outermost call.
    - `open`: equations whose inner jaxprs are being inlined, the outermost first.
    """

    builder: Builder
    named: bool
    library: Library | None
    within: str | None = None
    call: Any = None
    open: list[Any] = field(default_factory=list)

    def run(self, closed: Any, arrays: Sequence[Values], constants: Sequence[Values] | None = None) -> list[Values]:
        jaxpr = closed.jaxpr
        if constants is None:
            constants = [constant_array(self.builder, np.asarray(number)) for number in closed.consts]
        known: dict[Any, Values] = dict(zip(jaxpr.invars, arrays, strict=True))
        known.update(zip(jaxpr.constvars, constants, strict=True))
        for equation in jaxpr.eqns:
            results = self._equation(equation, [self._read(known, atom) for atom in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [self._read(known, atom) for atom in jaxpr.outvars]

    def _read(self, known: dict[Any, Values], atom: Any) -> Values:
        value = getattr(atom, "val", None)
        return known[atom] if value is None else constant_array(self.builder, np.asarray(value, atom.aval.dtype))

    def _equation(self, equation: Any, arrays: list[Values]) -> list[Values]:
        name = equation.primitive.name
        with as_native_code_error(lambda: f"the JAX primitive `{name}`{self._where(equation)}"):
            if name in ("jit", "pjit") and self.library is not None:
                shared = self._call(equation, arrays)
                if shared is not None:
                    return shared
            if name == "optimization_barrier" and self.library is not None:
                return [keep_array(self.builder, array) for array in arrays]
            if name in CALLS:
                around, self.call = self.call, self.call or equation
                inner = equation.params[CALLS[name]]
                results = self.run(inner if hasattr(inner, "jaxpr") else ClosedJaxpr(inner, ()), arrays)
                self.call = around
                return results
            if self.named:
                self.builder.origin = Origin(self.call or equation, within=self.within)
            if name in PLAIN:
                result = PLAIN[name](self.builder, equation, arrays)
                results = result if isinstance(result, list) else [result]
                if self.named:
                    self._mark(results)
                return results
            if name in WITH_JAXPRS:
                around, self.call = self.call, None
                origin = self.builder.origin
                self.open.append(around or equation)
                results = WITH_JAXPRS[name](self.builder, equation, arrays, self.run)
                self.open.pop()
                self.call = around
                if self.named:
                    self.builder.origin = origin
                    self._mark(results)
                return results
        remedy = REMEDIES.get(name, "write it with other operations of `jax.numpy`, or simulate with the engine `xla`")
        raise NoNativeCodeError(f"no native code for the JAX primitive `{name}`{self._where(equation)}: {remedy}")

    def _call(self, equation: Any, arrays: list[Values]) -> list[Values] | None:
        """Add a call of a shared function, and return its results; None if the call must be inlined."""
        assert self.library is not None

        def run(builder: Builder, closed: Any, inside: Sequence[Values], name: str) -> list[Values]:
            return _Inlining(builder, self.named, self.library, name).run(closed, inside)

        if self.named:
            self.builder.origin = Origin(self.call or equation, within=self.within)
        origin = self.builder.origin
        results = self.library.call(self.builder, equation, arrays, run)
        if results is not None and self.named:
            self.builder.origin = origin
            self._mark(results)
        return results

    def _mark(self, results: list[Values]) -> None:
        """Record the element's number in the origin of each new value."""
        origin = self.builder.origin
        for array in results:
            for k, value in enumerate(array.ravel()):
                if value.origin is origin:
                    value.origin = Origin(origin.equation, k, array.shape, origin.within, origin.visit)

    def _where(self, equation: Any) -> str:
        for nearest in (self.call or equation, *reversed(self.open)):
            for frame in frames_of(nearest)[:1]:
                return f" (line {frame.line} of {frame.file}, in `{frame.function}`)"
        return ""


def trace(
    function: Callable[..., Any],
    *args: Any,
    names: Sequence[str] | None = None,
    named: bool = True,
    library: Library | None = None,
) -> Program:
    """Trace `function(*args)` to a program; its inputs are the arrays in `args`, its outputs those in the result.

    An array's name consists of the argument's name and the path in its pytree: `parameters.surface.k1`, `state.q`.

    - `function`: pure, of pytrees of arrays.
    - `args`: arrays, or shapes with dtypes; only shapes and dtypes are used.
    - `names`: names of the arguments; None: `arg0`, `arg1`, ...
    - `named`: true to record the source location of each value, which takes time.
    - `library`: collects long functions under `jax.jit` as separate programs; None inlines all of them.

    Raises NoNativeCodeError if a primitive has no rule or its rule fails, and DefinitionError if the function depends
    on the values of its arrays in Python or the user's code raises an error.
    """
    builder = Builder()
    shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(np.shape(x), jax.dtypes.canonicalize_dtype(_dtype(x))), args)
    with located_tracing_errors():
        closed, result = jax.make_jaxpr(function, return_shape=True)(*shapes)
    with as_native_code_error(lambda: "the function"):
        inputs = [
            builder.input(name, ir_type(leaf.dtype, name), leaf.shape)
            for name, leaf in named_leaves(shapes, names or [f"arg{k}" for k in range(len(args))])
        ]
        results = inline(builder, closed, inputs, named=named, library=library)
        outputs = [name for name, _ in named_leaves((result,), ("",))]
        for name, values, aval in zip(outputs, results, closed.out_avals, strict=True):
            builder.output(name, ir_type(aval.dtype, name), values)
        return builder.finish()


def named_leaves(trees: Sequence[Any], names: Sequence[str]) -> list[tuple[str, Any]]:
    """Return pairs (name, array) for all arrays in pytrees; a name is the tree's name and the path in it, as `state.q`.

    - `names`: a name for each tree.
    """
    arrays = []
    for tree, name in zip(trees, names, strict=True):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            arrays.append(((name + _path_text(path)).lstrip("."), leaf))
    return arrays


def ir_type(dtype: Any, name: str) -> Any:
    """Return the IR type for a NumPy dtype.

    - `name`: name of the array, for the error.

    Raises NoNativeCodeError if the IR has no such type.
    """
    try:
        return type_of(dtype)
    except NotImplementedError as error:
        raise NoNativeCodeError(f"`{name}`: no native code for {error}") from None


def _path_text(path: Sequence[Any]) -> str:
    names = [getattr(key, part) for key in path for part in ("name", "key", "idx") if hasattr(key, part)]
    return "".join(f".{name}" for name in names)


def _dtype(x: Any) -> Any:
    return x.dtype if hasattr(x, "dtype") else np.asarray(x).dtype
