"""Names of values in generated code, valid in C, C++ and CUDA."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..ir import Program, Value
from .source_text import Named, Returned, about, function_called, operand, read_source, to_ascii

KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
alignas alignof and and_eq asm bitand bitor bool catch class co_await co_return co_yield compl concept const_cast
consteval constexpr constinit decltype delete dynamic_cast explicit export false friend mutable namespace new noexcept
not not_eq nullptr operator or or_eq private protected public reinterpret_cast requires static_assert static_cast
template this thread_local throw true try typeid typename using virtual wchar_t xor xor_eq
"""

LIBRARY = """
abs acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh div drem erf erfc erfinv exp exp10 exp2 expm1
fabs fdim finite floor fma fmax fmin fmod frexp gamma hypot ilogb isfinite isgreater isinf isless isnan isnormal j0 j1
jn labs ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround main math modf nan nearbyint nextafter norm
pow printf rand remainder remquo rint round rsqrt scalb scalbln scalbn signbit signgam significand sin sincos sinh sqrt
tan tanh tgamma time trunc y0 y1 yn
abort alloca calloc exit free malloc memcmp memcpy memmove memset qsort realloc
all_finite larger smaller erf_inv
int8_t int16_t int32_t int64_t uint8_t uint16_t uint32_t uint64_t size_t
linux unix
blockDim blockIdx gridDim threadIdx warpSize
"""
"""Functions of the C library, helpers of the generated code, and names that some compilers define."""

RESERVED = frozenset(f"{KEYWORDS} {LIBRARY}".split())


def identifier(name: str) -> str:
    """Return a name as an ASCII identifier that is not reserved in C, C++ or CUDA: `τ_1` becomes `tau_1`."""
    name = re.sub(r"\W+", "_", to_ascii(name)).strip("_") or "v"
    if name[0].isdigit():
        name = f"v{name}"
    # Functions of `math.h` also exist for floats, as `sinf`.
    return f"{name}_" if name in RESERVED or (name.endswith("f") and name[:-1] in RESERVED) else name


DERIVATIVES = frozenset({"jvp", "vjp", "grad", "value_and_grad", "jacfwd", "jacrev", "linearize", "hessian"})
OPERATORS: dict[type[ast.AST], str] = {ast.Sub: "sub", ast.Div: "div", ast.Add: "add", ast.Mult: "mul"}


class Name(NamedTuple):
    """The preferred name of a value in generated code.

    - `text`: an identifier.
    - `firm`: True for the name of a variable or input in the Python source, which a reader looks for; False for a name
      that is derived from a function or an operand.
    """

    text: str
    firm: bool


class Names:
    """Names and comments for the values of a program in generated code.

    A value is named after the variable to which the Python source assigns it, with its indices in the array, counted
    from 1: `s_1`, `m_12`. A value without a variable is named after the function that returned it. Otherwise it gets
    the name that the source uses for it as an operand.

    - `program`: its values have an `origin` (source location) with `frames`, `element` and `shape`, or None.
    - `chosen`: names of some values, which take precedence.
    """

    def __init__(self, program: Program, chosen: Mapping[Value, str] | None = None) -> None:
        self._names = {value: Name(identifier(name), True) for value, name in (chosen or {}).items()}
        self._about: dict[Value, str] = {}
        self._read_inputs(program)
        by_frames: dict[Any, list[Value]] = {}
        for value in program.walk():
            frames = tuple(value.origin.frames) if value.origin is not None and value.op != "const" else ()
            if frames and value.op != "input":
                self._about[value] = about(frames)
                by_frames.setdefault(frames, []).append(value)
        for frames, values in by_frames.items():
            self._name_results(values, frames)
        for frames, values in by_frames.items():
            if not _is_differentiated(frames):
                for value in values:
                    self._name_operands(value, frames[0])

    def of(self, value: Value) -> Name | None:
        """Return a value's preferred name, or None if it has none."""
        return self._names.get(value)

    def about(self, value: Value) -> str:
        """Return the comment on a value: the function that computes it, and its formula; empty if there is none."""
        return self._about.get(value, "")

    def _read_inputs(self, program: Program) -> None:
        """Name inputs by the shortest unique end of their paths: `state.q` is `q`, `gains.surface.q` is `surface_q`."""
        paths = [entry.name.split(".") for entry in program.inputs]
        short: dict[int, str] = {}
        for k in sorted(range(len(paths)), key=lambda k: len(paths[k])):
            ends = ["_".join(paths[k][-parts:]) for parts in range(1, len(paths[k]) + 1)]
            short[k] = next((end for end in ends if not end.isdigit() and end not in short.values()), ends[-1])
        for value in program.body.values:
            if value.op == "input":
                which, element = value.data
                text = identifier(short[which] + index_suffix(element, program.inputs[which].shape))
                self._names.setdefault(value, Name(text, True))

    def _name_results(self, values: list[Value], frames: tuple[Any, ...]) -> None:
        """Name the results of one expression, but not its intermediate values."""
        name = _result_name(frames)
        if name is None:
            return
        elements = [value for value in values if value.origin.element is not None]
        # The result comes last, except that derivatives come after the function's value.
        if not _is_differentiated(frames):
            elements.reverse()
        done: set[int] = set()
        for value in elements:
            if value.origin.shape == elements[0].origin.shape and value.origin.element not in done:
                done.add(value.origin.element)
                self._name(value, *name)

    def _name(self, value: Value, named: Named, firm: bool) -> None:
        if value not in self._names:
            index = "".join(str(k + 1) for k in named.path)
            number = index_suffix(value.origin.element, value.origin.shape).removeprefix("_")
            tail = f"_{index}{number}" if index or number else ""
            self._names[value] = Name(identifier(named.name + tail), firm)

    def _name_operands(self, value: Value, frame: Any) -> None:
        """Name the operands of an operation as the source does, if their order is known."""
        text = read_source(frame.file)
        node = None if text is None else text.at(frame)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and value.op == "neg":
            self._suggest(value.args[0], node.operand)
        if not isinstance(node, ast.BinOp) or OPERATORS.get(type(node.op)) != value.op:
            return
        sides = [node.left, node.right]
        args = list(value.args)
        if value.op in ("add", "mul"):
            # The builder may have swapped the operands: the name of one of them shows their order.
            known = [self._names[arg].text.partition("_")[0] if arg in self._names else None for arg in args]
            names = [operand(side) for side in sides]
            if any(name is not None and name == names[1 - k] for k, name in enumerate(known)):
                args.reverse()
            elif not any(name is not None and name == names[k] for k, name in enumerate(known)):
                return
        for arg, side in zip(args, sides, strict=True):
            self._suggest(arg, side)

    def _suggest(self, value: Value, node: ast.expr) -> None:
        text = operand(node)
        if text is None or value in self._names or value.op in ("const", "input") or value.origin is None:
            return
        number = index_suffix(value.origin.element, value.origin.shape) if value.origin.element is not None else ""
        self._names[value] = Name(identifier(text + number), False)


def index_suffix(element: int, shape: tuple[int, ...]) -> str:
    """Return the suffix of a name for an array element: `_2` in a vector, `_12` in a matrix; empty for a scalar.

    - `element`: index in C order, from 0. The suffix counts from 1.
    """
    digits: list[str] = []
    for length in reversed(shape):
        element, k = divmod(element, length)
        if length > 1 or len(shape) == 1:
            digits.insert(0, str(k + 1))
    return f"_{('' if max(shape, default=0) < 10 else '_').join(digits)}" if digits else ""


def _result_name(frames: tuple[Any, ...]) -> tuple[Named, bool] | None:
    """Return the name of an expression's result, and True for a variable or False for a function; else None."""
    value = Returned()
    differentiated = _is_differentiated(frames)
    function: Named | None = None
    for frame in frames:
        text = read_source(frame.file)
        node = None if text is None else text.at(frame)
        fate = None if text is None or node is None else text.fate(node, value)
        function_name = frame.function.rpartition(".")[2]
        if differentiated and function_name.startswith("_"):
            # In a differentiation rule, a name may stand for the function's value or for its derivative.
            return None
        if isinstance(fate, Named):
            name = fate.name.strip("_")
            return (Named(name, fate.path), True) if name else None
        if fate is None:
            break
        value = fate
        if function is None and value.position is None and function_name[:1].isalpha():
            function = Named(function_name, value.path)
    return None if function is None else (function, False)


def _is_differentiated(frames: tuple[Any, ...]) -> bool:
    for frame in frames:
        text = read_source(frame.file)
        node = None if text is None else text.at(frame)
        if isinstance(node, ast.Call) and function_called(node) in DERIVATIVES:
            return True
    return False
