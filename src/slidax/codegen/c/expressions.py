"""Operations as C expressions, with no more parentheses than C and its readers need."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..ir import FLOATS, Type
from .dialect import Dialect
from .helpers import BITS, Helpers

PRIMARY, UNARY, TIMES, PLUS, SHIFT, ORDER, EQUAL, AND, XOR, OR, BOTH, EITHER, CHOICE = range(15, 2, -1)
"""Precedences; a higher one binds tighter."""

SUM = {"add": ("+", PLUS), "sub": ("-", PLUS), "mul": ("*", TIMES), "div": ("/", TIMES)}
COMPARED = {"lt": ("<", ORDER), "le": ("<=", ORDER), "gt": (">", ORDER), "ge": (">=", ORDER)}
EQUATED = {"eq": ("==", EQUAL), "ne": ("!=", EQUAL)}
BITWISE = {"and": ("&", AND), "xor": ("^", XOR), "or": ("|", OR)}
LOGICAL = {"and": ("&&", BOTH), "or": ("||", EITHER), "xor": ("!=", EQUAL)}
CALLED = {"rem": "fmod", "abs": "fabs"}
OPPOSITE = {"lt": "ge", "le": "gt", "gt": "le", "ge": "lt", "eq": "ne", "ne": "eq"}

NO_READS: frozenset[str] = frozenset()


@dataclass(frozen=True)
class CExpression:
    """A C expression.

    - `precedence`: of its outermost operator.
    - `weight`: number of operations.
    - `reads`: variables of loops and inputs that it reads, which may be overwritten.
    """

    text: str
    precedence: int = PRIMARY
    weight: int = 0
    reads: frozenset[str] = NO_READS

    def within(self, precedence: int) -> str:
        """Return the text as an operand, in parentheses if it binds less tightly than `precedence`."""
        return self.text if self.precedence >= precedence else f"({self.text})"


def constant(number: float | int | bool, type: Type, dialect: Dialect) -> CExpression:
    """Return a number as an expression."""
    text = dialect.number(number, type)
    return CExpression(text, UNARY if text[0] == "-" or text.startswith("(double)") else PRIMARY)


class Expressions:
    """Write operations as expressions.

    - `helpers`: collects the helpers that they need.

    With `ordered_operands`, sums and products of the same operands have the same order, whatever numbers their names
    have.
    """

    def __init__(self, dialect: Dialect, helpers: Helpers) -> None:
        self.dialect = dialect
        self.helpers = helpers
        self.ordered_operands = False

    def operation(
        self, op: str, type: Type, of: Type, args: list[CExpression], *, cannot_overflow: bool = False
    ) -> CExpression:
        """Return an operation of the IR as an expression.

        - `of`: type of its last argument.
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
            raise NotImplementedError(f"no {op} of truth values")
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
    """Two operands; the operator groups from the left unless each operand must bind tighter."""
    left, right = args
    first = left.within(precedence if each is None else each)
    return f"{first} {sign} {right.within(precedence + 1 if each is None else each)}", precedence


def _negate(arg: CExpression) -> tuple[str, int]:
    if arg.precedence < TIMES or arg.text.startswith("-"):
        return f"-({arg.text})", UNARY
    # -a b is -(a b), to the last bit.
    return f"-{arg.text}", min(UNARY, arg.precedence)


def _is_negated(arg: CExpression) -> bool:
    return arg.text.startswith("-") and arg.precedence >= TIMES


def _commute(op: str, args: list[CExpression]) -> tuple[str, int]:
    """A sum or a product in the order with the fewest signs and parentheses: every order gives the same bits."""
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
