"""Identifiers for C, C++ and CUDA."""

from __future__ import annotations

import re

from .plain_text import plain

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
    """Turn a name, not empty, into an identifier that is not reserved in C, C++ or CUDA."""
    name = re.sub(r"\W+", "_", plain(name)).strip("_") or "v"
    if name[0].isdigit():
        name = f"v{name}"
    # Functions of `math.h` also exist for floats, as `sinf`.
    return f"{name}_" if name in RESERVED or (name.endswith("f") and name[:-1] in RESERVED) else name
