"""A closed loop together with its derivative in one direction."""

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
    """Arrays and their derivatives.

    - `value`: any tree.
    - `tangent`: the derivatives of its floating-point arrays; None elsewhere.
    """

    value: Any
    tangent: Any

    @property
    def fault(self) -> Fault:
        """Of a carry."""
        return self.value.fault


def duals(define: Callable[[Any], tuple[Loop, State]]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The beginning of a loop and one sample of it, as functions of `(at, direction)`, with their derivatives.

    - `define`: from arrays to a loop and the state at t = 0.
    """

    def begun(given: tuple[Any, Any]) -> tuple[Dual, Any, Any, Any]:
        at, direction = given
        (carry, *rest), (tangent, *_) = pushed(lambda at: begin(*define(at)), at, direction)
        return Dual(carry, tangent), *rest

    def turned(given: tuple[Any, Any], carry: Dual) -> tuple[Dual, Dual]:
        at, direction = given

        def moved(both: tuple[Any, Carry]) -> Any:
            return sample(define(both[0])[0], both[1])

        values, tangents = pushed(moved, (at, carry.value), (direction, carry.tangent))
        after, log = (Dual(value, tangent) for value, tangent in zip(values, tangents, strict=True))
        return after, log

    return begun, turned


def pushed(function: Callable[[Any], Any], at: Any, direction: Any) -> tuple[Any, Any]:
    """`f(x)` and `f'(x) v`, where only floating-point arrays have derivatives.

    - `function`: f, of one tree.
    - `at`: x.
    - `direction`: v; None for what has no derivative.
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
