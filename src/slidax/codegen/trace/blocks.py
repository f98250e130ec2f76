"""Loops and branches. They stay what they are; only what is known to be taken, or taken once, is written out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from slidax.codegen.builder import Builder, Values
from slidax.codegen.ir import Value

from .arrays import chosen, filled, of_list, type_of
from .packed import packed, unpacked

Inline = Callable[[Any, Sequence[Values]], list[Values]]
"""From a closed jaxpr and its arguments to its results."""

FEW = 64
"""A scan that stacks up to so many numbers carries them; one that stacks more is written out turn by turn."""


def while_loop(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """`lax.while_loop`."""
    params = equation.params
    of_condition, of_body = params["cond_nconsts"], params["body_nconsts"]
    condition_shares, shares = arrays[:of_condition], arrays[of_condition : of_condition + of_body]
    start = arrays[of_condition + of_body :]
    shapes = [array.shape for array in start]

    def condition(carried: Sequence[Value]) -> Value:
        (answer,) = inline(params["cond_jaxpr"], [*condition_shares, *unpacked(carried, shapes)])
        return answer.item()

    def body(carried: Sequence[Value]) -> list[Value]:
        return packed(inline(params["body_jaxpr"], [*shares, *unpacked(carried, shapes)]))

    return unpacked(b.loop(packed(start), condition, body), shapes)


def scan(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """`lax.scan`, and `lax.fori_loop` over known numbers."""
    params = equation.params
    length, reverse = params["length"], params["reverse"]
    shared, kept = _consts_and_carry(params)
    shares, carry, rows = arrays[:shared], arrays[shared : shared + kept], arrays[shared + kept :]
    avals = [var.aval for var in equation.outvars[kept:]]
    stacked = sum(int(np.prod(aval.shape, dtype=int)) for aval in avals)
    if length <= 1 or stacked > FEW:
        return _unrolled(params["jaxpr"], shares, carry, rows, (length, reverse), [a.shape for a in avals], inline)

    def turn(index: Value, carried: list[Values]) -> list[Values]:
        # How far from the start this turn's rows are.
        last = b.constant(length - 1, "i64")
        at = b.apply("sub", last, index) if reverse else index
        picked = [_row(b, array, at) for array in rows]
        results = inline(params["jaxpr"], [*shares, *carried[:kept], *picked])
        stacks = [_with_row(b, stack, at, row) for stack, row in zip(carried[kept:], results[kept:], strict=True)]
        return [*results[:kept], *stacks]

    # What the stacks hold before they are written is never read.
    start = [*carry, *(filled(b.constant(0, type_of(aval.dtype)), aval.shape) for aval in avals)]
    shapes = [array.shape for array in start]
    zero, one, turns = (b.constant(k, "i64") for k in (0, 1, length))
    left = b.loop(
        [zero, *packed(start)],
        lambda carried: b.apply("lt", carried[0], turns),
        lambda carried: [b.apply("add", carried[0], one), *packed(turn(carried[0], unpacked(carried[1:], shapes)))],
        turns,
    )
    return unpacked(left[1:], shapes)


def _consts_and_carry(params: dict[str, Any]) -> tuple[int, int]:
    if "ft_in" in params:
        consts, carry, _ = params["ft_in"].elts
        return len(list(consts.vals)), len(list(carry.vals))
    return params["num_consts"], params["num_carry"]


def _unrolled(
    jaxpr: Any,
    shares: list[Values],
    carry: list[Values],
    rows: list[Values],
    turns: tuple[int, bool],
    shapes: list[tuple[int, ...]],
    inline: Inline,
) -> list[Values]:
    length, reverse = turns
    stacks: list[Values] = [np.empty(shape, object) for shape in shapes]
    for k in reversed(range(length)) if reverse else range(length):
        results = inline(jaxpr, [*shares, *carry, *(_element(array, k) for array in rows)])
        carry = results[: len(carry)]
        for stack, row in zip(stacks, results[len(carry) :], strict=True):
            stack[k] = row.item() if row.ndim == 0 else row
    return [*carry, *stacks]


def _element(array: Values, k: int) -> Values:
    return array[k] if array.ndim > 1 else array[k : k + 1].reshape(())


def _row(b: Builder, array: Values, at: Value) -> Values:
    flat = array.reshape(array.shape[0], -1)
    return of_list([chosen(b, list(column), at) for column in flat.T], array.shape[1:])


def _with_row(b: Builder, stack: Values, at: Value, row: Values) -> Values:
    flat, new = stack.reshape(stack.shape[0], -1).copy(), row.ravel()
    for k in range(flat.shape[0]):
        here = b.apply("eq", at, b.constant(k, at.type))
        for column in range(flat.shape[1]):
            flat[k, column] = b.apply("select", here, new[column], flat[k, column])
    return flat.reshape(stack.shape)


def cond(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """`lax.cond` and `lax.switch`."""
    index, operands = arrays[0].item(), arrays[1:]
    branches = equation.params["branches"]
    return _switch(b, index, list(branches), 0, operands, inline)


def _switch(
    b: Builder, index: Value, branches: list[Any], first: int, operands: list[Values], inline: Inline
) -> list[Values]:
    """The branch whose number `index` is, the last for all beyond; `branches` are those from number `first` on."""
    if len(branches) == 1:
        return inline(branches[0], operands)
    values = b.branch(
        _is_up_to(b, index, first),
        lambda: packed(inline(branches[0], operands)),
        lambda: packed(_switch(b, index, branches[1:], first + 1, operands, inline)),
    )
    return unpacked(values, [aval.shape for aval in branches[0].out_avals])


def _is_up_to(b: Builder, index: Value, number: int) -> Value:
    """`index <= number`; a condition that became 0 or 1 is asked itself."""
    if index.op == "convert" and index.args[0].type == "b1":
        return b.apply("not", index.args[0])
    if index.type == "b1":
        return b.apply("not", index)
    return b.apply("le", index, b.constant(number, index.type))
