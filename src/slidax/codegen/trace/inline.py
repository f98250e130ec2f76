"""Inline a jaxpr into a builder, equation by equation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jax.extend.core import ClosedJaxpr  # type: ignore[attr-defined]

from slidax.codegen.builder import Builder, Values
from slidax.codegen.no_native_code import NoNativeCodeError, in_one_line

from . import blocks, elementwise, indexing, random, reductions, shapes
from .arrays import Inline, of_numbers
from .expanded import expand, linear_solve, platform_index
from .library import Library, place_together
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
"""Primitives that call another jaxpr, and the parameter that holds it."""

PLAIN: dict[str, Callable[[Builder, Any, list[Values]], Values | list[Values]]] = {
    **elementwise.ELEMENTWISE_RULES,
    **shapes.SHAPE_RULES,
    **reductions.REDUCTION_RULES,
    **indexing.INDEXING_RULES,
    "threefry2x32": random.threefry,
    "iota_2x32_shape": random.counters,
    "platform_index": platform_index,
    "random_wrap": random.key_words,
    "random_unwrap": random.key_words,
}
WITH_JAXPRS: dict[str, Callable[[Builder, Any, list[Values], Inline], list[Values]]] = {
    "while": blocks.while_loop,
    "scan": blocks.scan,
    "cond": blocks.cond,
    "call_hi_primitive": expand,
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
    "debug_callback": "remove the print",
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
    """Return the results of a closed jaxpr, as arrays of values.

    - `arrays`: its arguments.
    - `constants`: values of the arrays that it closes over; None: their numbers.
    - `named`: true if each value gets its origin in the source; takes time.
    - `library`: functions that stay functions; None inlines all of them.

    Raises NoNativeCodeError, with its name, its place in the source and a remedy, if a primitive has no rule or its
    rule fails.
    """
    return _Inlining(builder, named, library).run(closed, arrays, constants)


class _Inlining:
    def __init__(self, builder: Builder, named: bool, library: Library | None, within: str | None = None) -> None:
        self.builder = builder
        self.named = named
        self.library = library
        # The surrounding function. Its callers do not matter for origins.
        self.within = within
        # Equation of the call, inside a called function.
        self.call: Any = None
        # Equations whose inner jaxprs are open, the outermost first.
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
                return [place_together(self.builder, array) for array in arrays]
            if name in CALLS:
                around, self.call = self.call, self.call or equation
                results = self.run(_as_closed(equation.params[CALLS[name]]), arrays)
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
        """Results of a call that stays a call; None if it is inlined."""
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
        """Give each new value its element's number in the origin."""
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


def _as_closed(jaxpr: Any) -> Any:
    return jaxpr if hasattr(jaxpr, "jaxpr") else ClosedJaxpr(jaxpr, ())
