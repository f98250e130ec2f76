"""LLVM IR of a function that uses WebAssembly's multiply-add instruction."""

from __future__ import annotations

from slidax.codegen.ir import Value
from slidax.codegen.llvm.blocks import Blocks

PAIR = "<2 x double>"
FUSED = f"declare {PAIR} @llvm.wasm.relaxed.madd.v2f64({PAIR}, {PAIR}, {PAIR})"


class Body(Blocks):
    """LLVM IR of a function body."""

    def _value(self, value: Value) -> None:
        if value.op != "fma":
            super()._value(value)
            return
        name, pairs = f"%v{value.number}", []
        for k, arg in enumerate(value.args):
            # The number fills both lanes: a splat costs less than a vector with a zero.
            self._write(f"{name}h{k} = insertelement {PAIR} poison, double {self._word(arg, 1)}, i32 0")
            self._write(f"{name}w{k} = shufflevector {PAIR} {name}h{k}, {PAIR} poison, <2 x i32> zeroinitializer")
            pairs.append(f"{PAIR} {name}w{k}")
        self._write(f"{name}p = call {PAIR} @llvm.wasm.relaxed.madd.v2f64({', '.join(pairs)})")
        self._write(f"{name} = extractelement {PAIR} {name}p, i32 0")


def helpers(once: str, twice: str) -> list[str]:
    """LLVM IR of two functions that replace a multiply-add.

    - `once`: name of the function that rounds once, except for the last bit: exact product and sum (Dekker, Knuth).
    - `twice`: name of the function that rounds twice.
    """
    halves = f"splat (double {2.0**27 + 1.0})"
    steps = [
        ("product", "fmul", "%a", "%b"),
        *_halves("a", halves),
        *_halves("b", halves),
        ("hh", "fmul", "%ah", "%bh"),
        ("left1", "fsub", "%product", "%hh"),
        ("lh", "fmul", "%al", "%bh"),
        ("left2", "fsub", "%left1", "%lh"),
        ("hl", "fmul", "%ah", "%bl"),
        ("left3", "fsub", "%left2", "%hl"),
        ("ll", "fmul", "%al", "%bl"),
        ("rest", "fsub", "%ll", "%left3"),
        ("total", "fadd", "%product", "%c"),
        ("ofc", "fsub", "%total", "%product"),
        ("ofp", "fsub", "%total", "%ofc"),
        ("missp", "fsub", "%product", "%ofp"),
        ("missc", "fsub", "%c", "%ofc"),
        ("miss", "fadd", "%missp", "%missc"),
        ("more", "fadd", "%miss", "%rest"),
        ("exact", "fadd", "%total", "%more"),
    ]
    arguments = f"({PAIR} %a, {PAIR} %b, {PAIR} %c)"
    return [
        f"define {PAIR} @{once}{arguments} #0 {{",
        "entry:",
        *(f"%{name} = {op} {PAIR} {x}, {y}" for name, op, x, y in steps),
        # NaN where a number or its halves overflow: then the rounded sum is the result.
        f"%known = fcmp oeq {PAIR} %exact, %exact",
        f"%found = select <2 x i1> %known, {PAIR} %exact, {PAIR} %total",
        f"ret {PAIR} %found",
        "}",
        f"define {PAIR} @{twice}{arguments} #0 {{",
        "entry:",
        f"%product = fmul {PAIR} %a, %b",
        f"%sum = fadd {PAIR} %product, %c",
        f"ret {PAIR} %sum",
        "}",
    ]


def _halves(name: str, scale: str) -> list[tuple[str, str, str, str]]:
    """Split a number into two halves of its bits (Veltkamp)."""
    return [
        (f"{name}s", "fmul", f"%{name}", scale),
        (f"{name}d", "fsub", f"%{name}s", f"%{name}"),
        (f"{name}h", "fsub", f"%{name}s", f"%{name}d"),
        (f"{name}l", "fsub", f"%{name}", f"%{name}h"),
    ]
