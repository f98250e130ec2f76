"""C's types, numbers and function names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..ir import FLOATS, Number, Type

Real = Literal["double", "float"]

FLOAT_MAX = float(np.finfo(np.float32).max)
FLOAT_MIN = float(np.finfo(np.float32).tiny)

SIZES: dict[Type, int] = {"f64": 8, "f32": 4, "i64": 8, "i32": 4, "u64": 8, "u32": 4, "b1": 1, "none": 0}
"""Bytes of each type."""


@dataclass(frozen=True)
class Dialect:
    """C99, or the C++ of CUDA kernels.

    - `real`: C type of f64; "float" makes the whole program single precision.
    - `kernel`: true for a CUDA kernel: no headers, and helpers run on the device.
    """

    real: Real = "double"
    kernel: bool = False

    def effective_type(self, type: Type) -> Type:
        """Return the type of a value in C, in terms of the IR: f32 for f64 in a program of floats."""
        return "f32" if type == "f64" and self.real == "float" else type

    def type(self, type: Type) -> str:
        """Return the C name of a type."""
        return (_KERNEL_TYPES if self.kernel else _C_TYPES)[self.effective_type(type)]

    def size(self, type: Type) -> int:
        """Return the bytes of a value."""
        return SIZES[self.effective_type(type)]

    def function(self, name: str, type: Type) -> str:
        """Return the name of a function of `math.h`, from its name for doubles."""
        return name + "f" if self.effective_type(type) == "f32" else name

    def number(self, number: Number, type: Type) -> str:
        """Return a constant that reads back to the same bits; in a program of floats, the nearest float.

        A number beyond the range of floats becomes the largest or the smallest normal float, not infinity and not zero:
        such numbers mean "no limit", or keep a divisor from zero.
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
            return shortest(repr(number))
        if number != 0.0 and type == "f64":
            number = math.copysign(min(max(abs(number), FLOAT_MIN), FLOAT_MAX), number)
        return shortest(str(np.float32(number))) + "f"

    def _special(self, macro: str, single: bool) -> str:
        if self.kernel:
            bits = {"NAN": ("0x7fc00000", "0x7ff8000000000000"), "INFINITY": ("0x7f800000", "0x7ff0000000000000")}[
                macro
            ]
            return f"__int_as_float({bits[0]})" if single else f"__longlong_as_double({bits[1]}ll)"
        return macro if single else f"(double){macro}"


def shortest(number: str) -> str:
    """Return the shortest readable form of a decimal number in Python's notation: 0.5, 1e-3, 1000.0, 1e6."""
    sign, number = ("-", number[1:]) if number.startswith("-") else ("", number)
    mantissa, _, power = number.partition("e")
    whole, _, part = mantissa.partition(".")
    digits = (whole + part).lstrip("0")
    if not digits:
        return sign + "0.0"
    exponent = int(power or 0) + len(whole) - (len(whole + part) - len(digits)) - 1
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
