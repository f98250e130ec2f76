"""Small functions that C lacks, or does not define for every argument; printed where they are used."""

from __future__ import annotations

from ..ir import FLOATS, Type
from .dialect import Dialect

BITS: dict[Type, int] = {"i64": 64, "i32": 32, "u64": 64, "u32": 32}


class Helpers:
    """Helper functions of a piece of C."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._texts: dict[str, str] = {}

    @property
    def names(self) -> list[str]:
        return sorted(self._texts)

    @property
    def lines(self) -> list[str]:
        """Definitions as lines of C, an empty line after each."""
        return [line for name in self.names for line in [*self._texts[name].splitlines(), ""]]

    def extend(self, other: Helpers) -> None:
        """Add the helpers of another piece in the same file and dialect."""
        self._texts.update(other._texts)

    def name_of(self, op: str, type: Type) -> str:
        """Return the name of an operation's helper.

        - `op`: of the IR; `to_...` for a conversion from `type`, `bits_...` for the bits of a `type`, `all_finite`.
        - `type`: of its arguments.
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
            return _ALL_FINITE.format(before=before, own=own)
        if op.startswith("to_"):
            to: Type = op[3:]  # type: ignore[assignment]
            head = f"{before} {self.dialect.type(to)} {name}({own} x)"
            return f"/* Towards zero, held at the ends; 0 for NaN. */\n{head}\n{self._held(type, to)}"
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
                return "/* NaN if one of them is. */\n", two, f"a {sign} b || isnan(a) ? a : b"
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
            # C leaves the shift of a negative number to the compiler.
            return "", two, f"a < 0 ? ~({count} ? ~a >> b : 0) : ({count} ? a >> b : 0)"
        raise NotImplementedError(f"no helper for {op} of {type}")

    def _held(self, source: Type, to: Type) -> str:
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


_ALL_FINITE = """/* Whether all of n numbers are finite. */
{before} bool all_finite(const {own} *x, size_t n)
{{
    bool finite = true;
    for (size_t i = 0; i < n; ++i) {{
        finite = isfinite(x[i]) && finite;
    }}
    return finite;
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
