"""C expressions, types and numbers, and helper functions for operations that C lacks."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..ir import FLOATS, Number, Type

Real = Literal["double", "float"]

FLOAT_MAX = float(np.finfo(np.float32).max)
FLOAT_MIN = float(np.finfo(np.float32).tiny)


@dataclass(frozen=True)
class Dialect:
    """Language of the generated code: C99, or the C++ of CUDA kernels.

    - `real`: C type of the IR type f64; with "float" the whole program has single precision.
    - `kernel`: true for a CUDA kernel: no headers, and helpers run on the device.
    """

    real: Real = "double"
    kernel: bool = False

    def effective_type(self, type: Type) -> Type:
        """Return the IR type as which C stores values of an IR type: f32 for f64 if `real` is "float"."""
        return "f32" if type == "f64" and self.real == "float" else type

    def type(self, type: Type) -> str:
        """Return the C name of an IR type."""
        return (_KERNEL_TYPES if self.kernel else _C_TYPES)[self.effective_type(type)]

    def function(self, name: str, type: Type) -> str:
        """Return the name of a `math.h` function for arguments of an IR type: `sin` or `sinf` for `name` "sin"."""
        return name + "f" if self.effective_type(type) == "f32" else name

    def number(self, number: Number, type: Type) -> str:
        """Return a number as a C constant with exactly its value; in a program of floats, the nearest float.

        There, a number too large for a float becomes the largest float, not infinity, since it means "no limit". A
        number too small becomes the smallest normal float, not zero, since it prevents a division by zero.
        """
        if type == "b1":
            return "true" if number else "false"
        if type not in FLOATS:
            return _integer(int(number), type)
        number = float(number)
        single = self.effective_type(type) == "f32"
        if math.isnan(number):
            return self._special("NAN", single)
        if math.isinf(number):
            return ("-" if number < 0 else "") + self._special("INFINITY", single)
        if not single:
            return shortest_decimal(repr(number))
        if number != 0.0 and type == "f64":
            number = math.copysign(min(max(abs(number), FLOAT_MIN), FLOAT_MAX), number)
        return shortest_decimal(str(np.float32(number))) + "f"

    def _special(self, macro: str, single: bool) -> str:
        if self.kernel:
            bits = {"NAN": ("0x7fc00000", "0x7ff8000000000000"), "INFINITY": ("0x7f800000", "0x7ff0000000000000")}[
                macro
            ]
            return f"__int_as_float({bits[0]})" if single else f"__longlong_as_double({bits[1]}ll)"
        return macro if single else f"(double){macro}"


def shortest_decimal(number: str) -> str:
    """Shorten a decimal number without changing its value, to a form such as 0.5, 1e-3, 1000.0 or 1e6."""
    sign, number = ("-", number[1:]) if number.startswith("-") else ("", number)
    mantissa, _, power = number.partition("e")
    integer, _, fraction = mantissa.partition(".")
    digits = (integer + fraction).lstrip("0")
    if not digits:
        return sign + "0.0"
    exponent = int(power or 0) + len(integer) - (len(integer + fraction) - len(digits)) - 1
    digits = digits.rstrip("0")
    scientific = digits[0] + ("." + digits[1:] if len(digits) > 1 else "") + f"e{exponent}"
    if 0 <= exponent < 6:
        padded = digits.ljust(exponent + 1, "0")
        return f"{sign}{padded[: exponent + 1]}.{padded[exponent + 1 :] or '0'}"
    plain = "0." + "0" * (-exponent - 1) + digits if exponent < 0 else scientific
    return sign + (plain if len(plain) <= len(scientific) else scientific)


def _integer(number: int, type: Type) -> str:
    if type in ("u32", "u64"):
        return f"{number}u" if number < 2**16 else f"{number:#x}u"
    # C has no literal for the most negative number.
    if number in (-(2**31), -(2**63)):
        return f"(-{-(number + 1)} - 1)"
    return str(number)


_C_TYPES: dict[Type, str] = {
    "f64": "double",
    "f32": "float",
    "i64": "int64_t",
    "i32": "int32_t",
    "u64": "uint64_t",
    "u32": "uint32_t",
    "b1": "bool",
}
_KERNEL_TYPES: dict[Type, str] = {
    **_C_TYPES,
    "i64": "long long",
    "i32": "int",
    "u64": "unsigned long long",
    "u32": "unsigned int",
}


BITS: dict[Type, int] = {"i64": 64, "i32": 32, "u64": 64, "u32": 32}


class Helpers:
    """Collection of the helper functions that generated C calls, for operations that C lacks."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._texts: dict[str, str] = {}

    @property
    def names(self) -> list[str]:
        """Names of the functions, sorted."""
        return sorted(self._texts)

    @property
    def lines(self) -> list[str]:
        """Definitions as lines of C, an empty line after each."""
        return [line for name in self.names for line in [*self._texts[name].splitlines(), ""]]

    def extend(self, other: Helpers) -> None:
        """Add the helpers of another collection, for code in the same file and dialect."""
        self._texts.update(other._texts)

    def name_of(self, op: str, type: Type) -> str:
        """Return the name of the helper function for an operation; add the function if it is new.

        - `op`: IR operation; or `to_T` to convert to IR type T, `bits_T` to read the same bits as T, or `all_finite`.
        - `type`: IR type of the arguments.
        """
        real = self.dialect.effective_type("f64")
        type = self.dialect.effective_type(type)
        word = {"max": "larger", "min": "smaller"}.get(op, op)
        name = word if type == real else f"{word}_{type}"
        if name not in self._texts:
            self._texts[name] = self._text(op, name, type)
        return name

    def _text(self, op: str, name: str, type: Type) -> str:
        own = self.dialect.type(type)
        before = "static __device__ inline" if self.dialect.kernel else "static inline"
        if op == "erf_inv":
            return f"/* The y with erf(y) = x. */\n{before} double {name}(double x)\n{_ERF_INV}"
        if op == "all_finite":
            return _ALL_FINITE.format(before=before, own=own, zero=self.dialect.number(0.0, type))
        if op.startswith("to_"):
            to: Type = op[3:]  # type: ignore[assignment]
            head = f"{before} {self.dialect.type(to)} {name}({own} x)"
            return f"/* Rounds towards zero and saturates; 0 for NaN. */\n{head}\n{self._saturate(type, to)}"
        if op.startswith("bits_"):
            other = self.dialect.type(op[5:])  # type: ignore[arg-type]
            return f"{before} {other} {name}({own} x)\n{_BITS.format(own=own, other=other)}"
        comment, arguments, body = self._arithmetic(op, type, own)
        return f"{comment}{before} {own} {name}({arguments})\n{{\n    return {body};\n}}"

    def _arithmetic(self, op: str, type: Type, own: str) -> tuple[str, str, str]:
        two = f"{own} a, {own} b"
        if op in ("min", "max"):
            sign = ">" if op == "max" else "<"
            if type in FLOATS:
                return "/* NaN if a or b is NaN. */\n", two, f"a {sign} b || isnan(a) ? a : b"
            return "", two, f"a {sign} b ? a : b"
        bare = self.dialect.type("u64" if type in ("i64", "u64") else "u32")
        signed = type in ("i32", "i64")
        wraps = "/* Wraps around. */\n"
        if op in ("add", "sub", "mul"):
            sign = {"add": "+", "sub": "-", "mul": "*"}[op]
            return wraps, two, f"({own})(({bare})a {sign} ({bare})b)"
        if op == "neg":
            return wraps, f"{own} a", f"({own})(0u - ({bare})a)"
        if op == "abs":
            return wraps, f"{own} a", f"a < 0 ? ({own})(0u - ({bare})a) : a"
        if op == "div":
            text = f"b == 0 ? ({own})-1 : " + (f"b == -1 ? ({own})(0u - ({bare})a) : " if signed else "") + "a / b"
            return "/* Division by zero gives -1. */\n", two, text
        if op == "rem":
            return "", two, ("b == 0 ? a : b == -1 ? 0 : a % b" if signed else "b == 0 ? a : a % b")
        count = f"({bare})b < {BITS[type]}u"
        if op == "shl":
            return "", two, f"{count} ? ({own})(({bare})a << b) : 0"
        if op == "shr":
            return "", two, f"{count} ? ({own})(({bare})a >> b) : 0"
        if op == "sar":
            # In C, the shift of a negative number depends on the compiler.
            return "", two, f"a < 0 ? ~({count} ? ~a >> b : 0) : ({count} ? a >> b : 0)"
        raise NotImplementedError(f"C has no operation `{op}` for numbers of type {type}")

    def _saturate(self, source: Type, to: Type) -> str:
        number = self.dialect.number
        if to in ("i32", "i64"):
            least: int = -(2 ** (BITS[to] - 1))
            most = 2 ** (BITS[to] - 1) - 1
        else:
            least, most = 0, 2 ** BITS[to] - 1
        return "\n".join(
            [
                "{",
                f"    return isnan(x) ? 0 : x <= {number(least, source)} ? {number(least, to)}"
                f" : x >= {number(most + 1, source)} ? {number(most, to)} : ({self.dialect.type(to)})x;",
                "}",
            ]
        )


_ALL_FINITE = """/* True if all n numbers are finite: 0 x is NaN otherwise. Four sums do not wait for each other. */
{before} bool all_finite(const {own} *x, size_t n)
{{
    {own} a = {zero};
    {own} b = {zero};
    {own} c = {zero};
    {own} d = {zero};
    for (; n >= 4; n -= 4) {{
        a += {zero} * x[0];
        b += {zero} * x[1];
        c += {zero} * x[2];
        d += {zero} * x[3];
        x += 4;
    }}
    for (; n > 0; --n) {{
        a += {zero} * *x++;
    }}
    return isfinite(a + b + (c + d));
}}"""
_BITS = """{{
    union {{
        {own} number;
        {other} bits;
    }} both;
    both.number = x;
    return both.bits;
}}"""

_ERF_INV = """{
    /* Winitzki's closed form, to 2e-3; two steps of Halley's rule, with the complement where x is near one. */
    const double size = fabs(x);
    if (!(size < 1.0)) {
        return size > 1.0 || isnan(x) ? (double)NAN : copysign((double)INFINITY, x);
    }
    const double l = log1p(-size * size);
    const double c = 4.330746750799873 + 0.5 * l;
    double y = sqrt(fmax(sqrt(fmax(c * c - l / 0.147, 0.0)) - c, 0.0));
    for (int i = 0; i < 2; ++i) {
        const double off = size < 0.5 ? erf(y) - size : (1.0 - size) - erfc(y);
        const double step = off / (1.1283791670955126 * exp(-y * y));
        y -= step / (1.0 + y * step);
    }
    return copysign(y, x);
}"""


PRIMARY, UNARY, TIMES, PLUS, SHIFT, ORDER, EQUAL, AND, XOR, OR, BOTH, EITHER, CHOICE = range(15, 2, -1)
"""Precedences; a higher one binds tighter."""

SUM = {"add": ("+", PLUS), "sub": ("-", PLUS), "mul": ("*", TIMES), "div": ("/", TIMES)}
COMPARED = {"lt": ("<", ORDER), "le": ("<=", ORDER), "gt": (">", ORDER), "ge": (">=", ORDER)}
EQUATED = {"eq": ("==", EQUAL), "ne": ("!=", EQUAL)}
BITWISE = {"and": ("&", AND), "xor": ("^", XOR), "or": ("|", OR)}
LOGICAL = {"and": ("&&", BOTH), "or": ("||", EITHER), "xor": ("!=", EQUAL)}
CALLED = {"rem": "fmod", "abs": "fabs"}

NO_READS: frozenset[str] = frozenset()


@dataclass(frozen=True)
class CExpression:
    """A C expression.

    - `precedence`: precedence of its outermost operator.
    - `weight`: number of operations.
    - `reads`: loop variables and inputs that it reads; their values may be overwritten later.
    """

    text: str
    precedence: int = PRIMARY
    weight: int = 0
    reads: frozenset[str] = NO_READS

    def within(self, precedence: int) -> str:
        """Return the text as an operand: in parentheses if its operator binds less tightly than `precedence`."""
        return self.text if self.precedence >= precedence else f"({self.text})"


def constant(number: float | int | bool, type: Type, dialect: Dialect) -> CExpression:
    """Return a number of an IR type as a C expression."""
    text = dialect.number(number, type)
    return CExpression(text, UNARY if text[0] == "-" or text.startswith("(double)") else PRIMARY)


@dataclass
class Expressions:
    """Writer of IR operations as C expressions.

    - `helpers`: collects the helpers that the expressions need.
    - `ordered_operands`: True to order the operands of sums and products by their names without numbers, so that
      similar expressions for different joints have the same form.
    """

    dialect: Dialect
    helpers: Helpers
    ordered_operands: bool = False

    def operation(
        self, op: str, type: Type, of: Type, args: list[CExpression], *, cannot_overflow: bool = False
    ) -> CExpression:
        """Return an IR operation as a C expression.

        - `type`: type of the result.
        - `of`: type of the last argument.
        - `args`: arguments, as C expressions.
        - `cannot_overflow`: true for a sum of integers that cannot overflow.
        """
        if self.ordered_operands and op in ("add", "mul") and type in FLOATS:
            args = sorted(args, key=lambda arg: (arg.precedence, re.sub(r"\d+", "", arg.text)))
        text, precedence = _commute(op, args) if cannot_overflow else self._text(op, type, of, args)
        weight = 1 + sum(arg.weight for arg in args)
        return CExpression(text, precedence, weight, NO_READS.union(*[arg.reads for arg in args]))

    def _text(self, op: str, type: Type, of: Type, args: list[CExpression]) -> tuple[str, int]:
        if op in COMPARED:
            return _two(args, *COMPARED[op], each=SHIFT)
        if op in EQUATED:
            if args[0].text == args[1].text and of in FLOATS:
                return (f"isnan({args[0].text})", PRIMARY) if op == "ne" else (f"!isnan({args[0].text})", UNARY)
            return _two(args[::-1] if _is_number(args[0]) else args, *EQUATED[op], each=SHIFT)
        if op == "select":
            when, yes, no = args
            # A nested choice is readable only as an else-if.
            return f"{when.within(EITHER)} ? {yes.within(EITHER)} : {no.within(CHOICE)}", CHOICE
        if op == "copy":
            return args[0].text, args[0].precedence
        if op == "convert":
            return self._convert(type, of, args[0])
        if op == "bitcast":
            return self._bits(type, of, args[0])
        if type == "b1":
            return self._logical(op, args)
        return self._real(op, type, args) if type in FLOATS else self._integer(op, type, args)

    def _real(self, op: str, type: Type, args: list[CExpression]) -> tuple[str, int]:
        if op in ("add", "mul"):
            return _commute(op, args)
        if op == "sub" and _is_negated(args[1]):
            return f"{args[0].within(PLUS)} + {args[1].text[1:]}", PLUS
        if op in SUM:
            return _two(args, *SUM[op])
        if op == "neg":
            return _negate(args[0])
        if op in ("min", "max"):
            return _call(self.helpers.name_of(op, type), args)
        if op == "erf_inv":
            return self._erf_inv(type, args[0])
        return _call(self.dialect.function(CALLED.get(op, op), type), args)

    def _erf_inv(self, type: Type, arg: CExpression) -> tuple[str, int]:
        if self.dialect.kernel:
            return _call(self.dialect.function("erfinv", type), [arg])
        name = self.helpers.name_of("erf_inv", "f64")
        if self.dialect.effective_type(type) == "f32":
            return f"(float){name}((double){arg.within(UNARY)})", UNARY
        return _call(name, [arg])

    def _integer(self, op: str, type: Type, args: list[CExpression]) -> tuple[str, int]:
        signed = type in ("i32", "i64")
        if op == "not":
            return f"~{args[0].within(UNARY)}", UNARY
        if op in BITWISE:
            return _two(args, *BITWISE[op], each=PRIMARY)
        if op in ("div", "rem") and args[1].text.rstrip("u").isdigit() and args[1].text.rstrip("u") != "0":
            return _two(args, "/" if op == "div" else "%", TIMES)
        if op in ("shl", "shr", "sar") and not signed:
            count = args[1].text.rstrip("u")
            if count.isdigit() and int(count) < BITS[type]:
                return _two(args, "<<" if op == "shl" else ">>", SHIFT, each=PRIMARY)
        if op in SUM and op != "div" and not signed:
            return _two(args, *SUM[op])
        return _call(self.helpers.name_of(op, type), args)

    def _logical(self, op: str, args: list[CExpression]) -> tuple[str, int]:
        if op == "not":
            return f"!{args[0].within(UNARY)}", UNARY
        if op == "isfinite":
            return f"isfinite({args[0].text})", PRIMARY
        if op not in LOGICAL:
            raise NotImplementedError(f"C has no operation `{op}` for truth values")
        sign, precedence = LOGICAL[op]
        # Compilers warn about && within || without parentheses.
        if op == "or":
            sides = [f"({arg.text})" if arg.precedence == BOTH else arg.within(EITHER) for arg in args]
            return f" {sign} ".join(sides), precedence
        return _two(args, sign, precedence, each=BOTH if op == "and" else SHIFT)

    def _convert(self, type: Type, of: Type, arg: CExpression) -> tuple[str, int]:
        type, of = self.dialect.effective_type(type), self.dialect.effective_type(of)
        if type == of:
            return arg.text, arg.precedence
        zero, unit = self.dialect.number(0, of if type == "b1" else type), self.dialect.number(1, type)
        if type == "b1":
            return f"{arg.within(SHIFT)} != {zero}", EQUAL
        if of == "b1":
            return f"{arg.within(EITHER)} ? {unit} : {zero}", CHOICE
        if of in FLOATS and type not in FLOATS:
            return _call(self.helpers.name_of(f"to_{type}", of), [arg])
        return f"({self.dialect.type(type)}){arg.within(UNARY)}", UNARY

    def _bits(self, type: Type, of: Type, arg: CExpression) -> tuple[str, int]:
        if type == of:
            return arg.text, arg.precedence
        text = arg.text
        narrow = self.dialect.real == "float"
        if {type, of} <= {"i32", "u32"} or {type, of} <= {"i64", "u64"}:
            return f"({self.dialect.type(type)}){arg.within(UNARY)}", UNARY
        # In a program of floats, the bits of a double are still those of a double.
        wide = Dialect("double", self.dialect.kernel) if narrow else self.dialect
        helpers = Helpers(wide)
        name = helpers.name_of(f"bits_{type}", of)
        self.helpers.extend(helpers)
        if narrow and of == "f64":
            text = f"(double){arg.within(UNARY)}"
        if narrow and type == "f64":
            return f"(float){name}({text})", UNARY
        return f"{name}({text})", PRIMARY


def _call(name: str, args: list[CExpression]) -> tuple[str, int]:
    return f"{name}({', '.join(arg.text for arg in args)})", PRIMARY


def _two(args: list[CExpression], sign: str, precedence: int, *, each: int | None = None) -> tuple[str, int]:
    """Join two operands by an operator that groups from the left.

    - `each`: least precedence of both operands, for an operator that does not group.
    """
    left, right = args
    first = left.within(precedence if each is None else each)
    return f"{first} {sign} {right.within(precedence + 1 if each is None else each)}", precedence


def _negate(arg: CExpression) -> tuple[str, int]:
    if arg.precedence < TIMES or arg.text.startswith("-"):
        return f"-({arg.text})", UNARY
    # -a b and -(a b) are bitwise equal.
    return f"-{arg.text}", min(UNARY, arg.precedence)


def _is_negated(arg: CExpression) -> bool:
    return arg.text.startswith("-") and arg.precedence >= TIMES


def _commute(op: str, args: list[CExpression]) -> tuple[str, int]:
    """Write a sum or a product in the order with the fewest signs and parentheses; the order does not change a bit."""
    left, right = args
    sign, precedence = SUM[op]
    if op == "add":
        if not _is_negated(right) and (_is_negated(left) or _is_number(left)):
            left, right = right, left
        if _is_negated(right):
            return f"{left.within(PLUS)} - {right.text[1:]}", PLUS
    first = right.precedence == precedence or (op == "mul" and (_is_number(right) or _is_negated(right)))
    if first and left.precedence != precedence:
        left, right = right, left
    return f"{left.within(precedence)} {sign} {right.within(precedence + 1)}", precedence


def _is_number(arg: CExpression) -> bool:
    return arg.weight == 0 and arg.text.lstrip("-")[:1].isdigit()
