"""A jaxpr, equation by equation, into a builder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr  # type: ignore[attr-defined]

from slidax.codegen.builder import Builder, Values
from slidax.codegen.no_native_code import NoNativeCodeError, in_one_line

from . import blocks, elementwise, indexing, random, reductions, shapes
from .arrays import of_numbers
from .expanded import expanded, linear_solve, platform_index
from .library import Library, together
from .origin import Origin, frames_of

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
"""Primitives that call another jaxpr, with the parameter that holds it."""

PLAIN: dict[str, Callable[[Builder, Any, list[Values]], Values | list[Values]]] = {
    **elementwise.RULES,
    **shapes.RULES,
    **reductions.RULES,
    **indexing.RULES,
    "threefry2x32": random.threefry,
    "iota_2x32_shape": random.counters,
    "platform_index": platform_index,
    "random_wrap": random.same_words,
    "random_unwrap": random.same_words,
}
WITH_INNER: dict[str, Callable[[Builder, Any, list[Values], blocks.Inline], list[Values]]] = {
    "while": blocks.while_loop,
    "scan": blocks.scan,
    "cond": blocks.cond,
    "call_hi_primitive": expanded,
    "custom_linear_solve": linear_solve,
    "linear_solve": linear_solve,
    "random_seed": random.by_implementation("seed"),
    "random_fold_in": random.by_implementation("fold_in"),
    "random_bits": random.by_implementation("random_bits"),
    "random_split": random.by_implementation("split"),
}
REMEDIES = {
    "sort": "write it with `jnp.max`, `jnp.min` or `jnp.argmax`",
    "top_k": "write it with `jnp.max` or `jnp.argmax`",
    "cholesky": "use `slidax.numerics.solve_symmetric`",
    "triangular_solve": "use `slidax.numerics.solve_symmetric`",
    "lu": "use `slidax.numerics.solve_symmetric`",
    "eigh": "use `slidax.numerics.inverse_norm`, or a closed form",
    "svd": "use `slidax.numerics.inverse_norm`, or a closed form",
    "qr": "use `slidax.numerics.solve_symmetric`",
    "pure_callback": "write it in `jax.numpy`",
    "io_callback": "write it in `jax.numpy`",
    "debug_callback": "take the print out",
}


def inline(
    builder: Builder,
    closed: Any,
    arrays: Sequence[Values],
    *,
    constants: Sequence[Values] | None = None,
    named: bool = False,
    library: Library | None = None,
) -> list[Values]:
    """The results of a closed jaxpr, as arrays of values.

    - `builder`: makes them.
    - `closed`: the jaxpr.
    - `arrays`: its arguments.
    - `constants`: what stands for the arrays that it closes over; None: their numbers.
    - `named`: whether each value is told where in the source it came from; takes time.
    - `library`: has the functions that stay functions; None: all is written out.

    Raises NoNativeCodeError if it holds a primitive that has no rule, or one whose rule fails: its name, where it
    stands in the source, and the remedy or the failure.
    """
    return _Inlining(builder, named, library).run(closed, arrays, constants)


class _Inlining:
    def __init__(self, builder: Builder, named: bool, library: Library | None, within: str | None = None) -> None:
        self.builder = builder
        self.named = named
        self.library = library
        # The function that all this is inside of: who called it is no matter of what is in it.
        self.within = within
        # Inside a called function, the place of the call.
        self.call: Any = None
        # Those whose inner jaxprs are open, the outermost first.
        self.open: list[Any] = []

    def run(self, closed: Any, arrays: Sequence[Values], constants: Sequence[Values] | None = None) -> list[Values]:
        jaxpr = closed.jaxpr
        if constants is None:
            constants = [of_numbers(self.builder, np.asarray(number)) for number in closed.consts]
        known: dict[Any, Values] = dict(zip(jaxpr.invars, arrays, strict=True))
        known.update(zip(jaxpr.constvars, constants, strict=True))
        for equation in jaxpr.eqns:
            results = self._equation(equation, [self._read(known, atom) for atom in equation.invars])
            known.update(zip(equation.outvars, results, strict=True))
        return [self._read(known, atom) for atom in jaxpr.outvars]

    def _read(self, known: dict[Any, Values], atom: Any) -> Values:
        value = getattr(atom, "val", None)
        return known[atom] if value is None else of_numbers(self.builder, np.asarray(value, atom.aval.dtype))

    def _equation(self, equation: Any, arrays: list[Values]) -> list[Values]:
        name = equation.primitive.name
        with in_one_line(lambda: f"the JAX primitive `{name}`{self._where(equation)}"):
            if name in ("jit", "pjit") and self.library is not None:
                shared = self._call(equation, arrays)
                if shared is not None:
                    return shared
            if name == "optimization_barrier" and self.library is not None:
                return [together(self.builder, array) for array in arrays]
            if name in CALLS:
                around, self.call = self.call, self.call or equation
                results = self.run(_closed(equation.params[CALLS[name]]), arrays)
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
            if name in WITH_INNER:
                around, self.call = self.call, None
                mine = self.builder.origin
                self.open.append(around or equation)
                results = WITH_INNER[name](self.builder, equation, arrays, self.run)
                self.open.pop()
                self.call = around
                if self.named:
                    self.builder.origin = mine
                    self._mark(results)
                return results
        remedy = REMEDIES.get(name, "write it with other operations of `jax.numpy`, or simulate with the engine `xla`")
        raise NoNativeCodeError(f"no native code for the JAX primitive `{name}`{self._where(equation)}: {remedy}")

    def _call(self, equation: Any, arrays: list[Values]) -> list[Values] | None:
        """The results of a function that stays one."""
        assert self.library is not None

        def run(builder: Builder, closed: Any, inside: Sequence[Values], name: str) -> list[Values]:
            return _Inlining(builder, self.named, self.library, name).run(closed, inside)

        if self.named:
            self.builder.origin = Origin(self.call or equation, within=self.within)
        mine = self.builder.origin
        results = self.library.call(self.builder, equation, arrays, run)
        if results is not None and self.named:
            self.builder.origin = mine
            self._mark(results)
        return results

    def _mark(self, results: list[Values]) -> None:
        """Tells each new value which element of the result it is."""
        mine = self.builder.origin
        for array in results:
            for k, value in enumerate(array.ravel()):
                if value.origin is mine:
                    value.origin = Origin(mine.equation, k, array.shape, mine.within, mine.visit)

    def _where(self, equation: Any) -> str:
        for made in (self.call or equation, *reversed(self.open)):
            for frame in frames_of(made)[:1]:
                return f" (line {frame.line} of {frame.file}, in `{frame.function}`)"
        return ""


def _closed(jaxpr: Any) -> Any:
    return jaxpr if hasattr(jaxpr, "jaxpr") else ClosedJaxpr(jaxpr, ())
