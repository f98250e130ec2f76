"""IR values with Python's operators, so that a formula in Python builds a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..builder import Builder
from ..ir import Number, Type, Value

SIGN = 1 << 63
"""The sign bit."""


def _operator(op: str) -> Callable[[Expression, Expression | Number], Expression]:
    def method(self: Expression, other: Expression | Number) -> Expression:
        return self._apply(op, other)

    return method


@dataclass(slots=True, eq=False)
class Expression:
    """An IR value with Python's operators. An operator adds an operation to the program; numbers become constants.

    Comparisons return a truth value (b1). `equals` and `differs` compare for equality; NaN differs from every number.
    """

    builder: Builder
    value: Value

    def constant(self, number: Number) -> Expression:
        """A constant of this value's type."""
        return Expression(self.builder, self.builder.constant(number, self.value.type))

    def _operand(self, other: Expression | Number) -> Value:
        return other.value if isinstance(other, Expression) else self.builder.constant(other, self.value.type)

    def _apply(self, op: str, *others: Expression | Number) -> Expression:
        operands = [self._operand(other) for other in others]
        return Expression(self.builder, self.builder.apply(op, self.value, *operands))

    __add__, __sub__, __mul__, __truediv__ = _operator("add"), _operator("sub"), _operator("mul"), _operator("div")
    __and__, __or__, __xor__ = _operator("and"), _operator("or"), _operator("xor")
    __lshift__, __rshift__ = _operator("shl"), _operator("shr")
    __lt__, __le__, __gt__, __ge__ = _operator("lt"), _operator("le"), _operator("gt"), _operator("ge")
    equals, differs = _operator("eq"), _operator("ne")
    __rmul__ = __mul__

    def __rsub__(self, other: Number) -> Expression:
        return self.constant(other) - self

    def __rtruediv__(self, other: Number) -> Expression:
        return self.constant(other) / self

    def __neg__(self) -> Expression:
        return self._apply("neg")

    def __abs__(self) -> Expression:
        return self._apply("abs")

    def __invert__(self) -> Expression:
        return self._apply("not")

    def rounded(self) -> Expression:
        """The nearest integer; halves are rounded to even."""
        return self._apply("rint")

    def root(self) -> Expression:
        """The square root."""
        return self._apply("sqrt")

    def bits(self) -> Expression:
        """The bits of a f64, as u64."""
        return self.cast("bitcast", "u64")

    def number(self) -> Expression:
        """The f64 whose bits are this u64."""
        return self.cast("bitcast", "f64")

    def signed_as(self, other: Expression) -> Expression:
        """This number with the sign of `other`; this number must be >= 0."""
        return (self.bits() | (other.bits() & SIGN)).number()

    def flipped(self, sign: Expression) -> Expression:
        """This number, negated if the u64 `sign` is `SIGN` (the sign bit), unchanged if it is 0."""
        return (self.bits() ^ sign).number()

    def cast(self, op: str, type: Type) -> Expression:
        """This value as another type: with equal bits if `op` is "bitcast", with equal value if `op` is "convert"."""
        return Expression(self.builder, self.builder.apply(op, self.value, type=type))

    def at_most(self, limit: float) -> Expression:
        """The minimum of this number and `limit`; NaN stays NaN."""
        return select(self > limit, limit, self)

    def at_least(self, limit: float) -> Expression:
        """The maximum of this number and `limit`; NaN stays NaN."""
        return select(self < limit, limit, self)

    def within(self, limit: float) -> Expression:
        """This number, limited to ±limit; NaN becomes `limit`."""
        upper = select(self < limit, self, limit)
        return select(upper > -limit, upper, -limit)


def fma(a: Expression, b: Expression | Number, c: Expression | Number) -> Expression:
    """`a b + c`, rounded once."""
    return a._apply("fma", b, c)


def select(when: Expression, yes: Expression | Number, no: Expression | Number) -> Expression:
    """`yes` where `when` is true, else `no`; one of them must be an expression, which defines the type."""
    like = yes if isinstance(yes, Expression) else no
    assert isinstance(like, Expression)
    builder = when.builder
    return Expression(builder, builder.apply("select", when.value, like._operand(yes), like._operand(no)))


def branch_rarely(
    when: Expression, then: Callable[[], tuple[Expression, ...]], else_these: tuple[Expression, ...]
) -> tuple[Expression, ...]:
    """Add a branch for a rare case: return the values of `then()` if `when` is true, else the values `else_these`.

    A second call with the same `when` and `else_these` adds no branch; it returns the results of the first call.

    - `when`: condition (b1), computed from the same numbers as `else_these`.
    - `then`: function that builds as many values as `else_these` has, of the same types.
    - `else_these`: values of the usual case, all in one region. The branch is added to this region.
    """
    builder, region = when.builder, else_these[0].value.region
    keys = [("rarely", when.value.number, value.value.number) for value in else_these]
    if keys[0] not in region.known:
        around, builder.region = builder.region, region
        results = builder.branch(
            when.value, lambda: [value.value for value in then()], lambda: [value.value for value in else_these]
        )
        builder.region = around
        region.known.update(zip(keys, results, strict=True))
    return tuple(Expression(builder, region.known[key]) for key in keys)


def polynomial(x: Expression, coefficients: tuple[float, ...]) -> Expression:
    """The polynomial `c0 + c1 x + c2 x² + ...` by Estrin's scheme, whose parts can be computed in parallel.

    - `coefficients`: c0, c1, c2, ...
    """
    terms: list[Expression] = [x.constant(c) for c in coefficients]
    power = x
    while len(terms) > 1:
        pairs = [fma(high, power, low) for low, high in zip(terms[::2], terms[1::2], strict=False)]
        terms = pairs + terms[len(pairs) * 2 :]
        if len(terms) > 1:
            power = power * power
    return terms[0]
