"""A closed loop with its derivative in one direction (dual numbers)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax

from slidax._types import State

from .loop import Carry, Loop
from .outcome import Fault
from .rollout import begin, sample


class Dual(eqx.Module):
    """A tree, and the derivatives of its floating-point arrays (None elsewhere)."""

    value: Any
    tangent: Any

    @property
    def fault(self) -> Fault:
        return self.value.fault


def duals(define: Callable[[Any], tuple[Loop, State]]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the start of a loop and one sample of it, with derivatives, as functions of `(at, direction)`.

    - `define`: maps arrays to a loop and the state at t = 0.
    """

    def begin_dual(point: tuple[Any, Any]) -> tuple[Dual, Any, Any, Any]:
        (carry, *rest), (tangent, *_) = jvp(lambda at: begin(*define(at)), *point)
        return Dual(carry, tangent), *rest

    def sample_dual(point: tuple[Any, Any], carry: Dual) -> tuple[Dual, Dual]:
        def step(at_and_carry: tuple[Any, Carry]) -> Any:
            at, before = at_and_carry
            return sample(define(at)[0], before)

        at, direction = point
        values, tangents = jvp(step, (at, carry.value), (direction, carry.tangent))
        after, log = (Dual(value, tangent) for value, tangent in zip(values, tangents, strict=True))
        return after, log

    return begin_dual, sample_dual


def jvp(function: Callable[[Any], Any], at: Any, direction: Any) -> tuple[Any, Any]:
    """Return `f(x)` and `f'(x) v` of a function of one tree, in which only floating-point arrays have derivatives.

    - `direction`: v, None where x has no derivative.
    """
    floats, rest = eqx.partition(at, eqx.is_inexact_array)
    leaves, tree = jax.tree.flatten(floats)
    static: list[Any] = []

    def of_floats(*leaves: Any) -> Any:
        result = function(eqx.combine(jax.tree.unflatten(tree, leaves), rest))
        smooth, others = eqx.partition(result, eqx.is_inexact_array)
        arrays, left = eqx.partition(others, eqx.is_array)
        static[:] = [left]
        return smooth, arrays

    values, tangents, arrays = jax.jvp(of_floats, leaves, jax.tree.leaves(direction), has_aux=True)
    return eqx.combine(values, arrays, static[0]), tangents
