"""Rules that translate JAX's loops, branches, and primitives that JAX expands into others, to IR operations.

A rule gets the program's builder, the jaxpr's equation and its operands, and, if it needs it, `inline`: a function that
appends the operations of another jaxpr. It returns the results as arrays of IR values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from ..builder import Builder, Values
from ..ir import Value
from .arrays import Inline, constant_array, full_array, pack, select_element, type_of, unpack, value_array

FEW = 64
"""Largest number of elements of stacked results in a scan that becomes a loop; a scan with more is unrolled."""


def while_loop(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Rule of `lax.while_loop`: append a loop to the program, and return the carried values after it."""
    params = equation.params
    n_condition, n_body = params["cond_nconsts"], params["body_nconsts"]
    condition_shares, shares = arrays[:n_condition], arrays[n_condition : n_condition + n_body]
    start = arrays[n_condition + n_body :]
    shapes = [array.shape for array in start]

    def condition(carried: Sequence[Value]) -> Value:
        (answer,) = inline(params["cond_jaxpr"], [*condition_shares, *unpack(carried, shapes)])
        return answer.item()

    def body(carried: Sequence[Value]) -> list[Value]:
        return pack(inline(params["body_jaxpr"], [*shares, *unpack(carried, shapes)]))

    return unpack(b.loop(pack(start), condition, body), shapes)


def scan(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Rule of `lax.scan`, and of `lax.fori_loop` over a known range: append a loop, or each iteration one by one.

    Iterations are appended one by one if there is at most one, or if a loop would stack more than `FEW` elements.
    Returns the carried values after the last iteration, and the stacked results.
    """
    params = equation.params
    length, reverse = params["length"], params["reverse"]
    shared, n_carry = _consts_and_carry(params)
    shares, carry, rows = arrays[:shared], arrays[shared : shared + n_carry], arrays[shared + n_carry :]
    avals = [var.aval for var in equation.outvars[n_carry:]]
    stacked = sum(int(np.prod(aval.shape, dtype=int)) for aval in avals)
    if length <= 1 or stacked > FEW:
        return _unroll(params["jaxpr"], shares, carry, rows, (length, reverse), [a.shape for a in avals], inline)

    def iterate(index: Value, carried: list[Values]) -> list[Values]:
        last = b.constant(length - 1, "i64")
        at = b.apply("sub", last, index) if reverse else index
        picked = [_row(b, array, at) for array in rows]
        results = inline(params["jaxpr"], [*shares, *carried[:n_carry], *picked])
        stacks = [_with_row(b, stack, at, row) for stack, row in zip(carried[n_carry:], results[n_carry:], strict=True)]
        return [*results[:n_carry], *stacks]

    # The initial content of the stacks is never read.
    start = [*carry, *(full_array(b.constant(0, type_of(aval.dtype)), aval.shape) for aval in avals)]
    shapes = [array.shape for array in start]
    zero, unit, iterations = (b.constant(k, "i64") for k in (0, 1, length))
    left = b.loop(
        [zero, *pack(start)],
        lambda carried: b.apply("lt", carried[0], iterations),
        lambda carried: [b.apply("add", carried[0], unit), *pack(iterate(carried[0], unpack(carried[1:], shapes)))],
        iterations,
    )
    return unpack(left[1:], shapes)


def _consts_and_carry(params: dict[str, Any]) -> tuple[int, int]:
    if "ft_in" in params:
        consts, carry, _ = params["ft_in"].elts
        return len(list(consts.vals)), len(list(carry.vals))
    return params["num_consts"], params["num_carry"]


def _unroll(
    jaxpr: Any,
    shares: list[Values],
    carry: list[Values],
    rows: list[Values],
    iterations: tuple[int, bool],
    shapes: list[tuple[int, ...]],
    inline: Inline,
) -> list[Values]:
    length, reverse = iterations
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
    return value_array([select_element(b, list(column), at) for column in flat.T], array.shape[1:])


def _with_row(b: Builder, stack: Values, at: Value, row: Values) -> Values:
    flat, new = stack.reshape(stack.shape[0], -1).copy(), row.ravel()
    for k in range(flat.shape[0]):
        here = b.apply("eq", at, b.constant(k, at.type))
        for column in range(flat.shape[1]):
            flat[k, column] = b.apply("select", here, new[column], flat[k, column])
    return flat.reshape(stack.shape)


def cond(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Rule of `lax.cond` and `lax.switch`: append a branch for each case, and return the results of the chosen case."""
    index, operands = arrays[0].item(), arrays[1:]
    branches = equation.params["branches"]
    return _switch(b, index, list(branches), 0, operands, inline)


def _switch(
    b: Builder, index: Value, branches: list[Any], first: int, operands: list[Values], inline: Inline
) -> list[Values]:
    """Return the results of branch `index`, or of the last if it is too large; `branches` begin with number `first`."""
    if len(branches) == 1:
        return inline(branches[0], operands)
    values = b.branch(
        _is_up_to(b, index, first),
        lambda: pack(inline(branches[0], operands)),
        lambda: pack(_switch(b, index, branches[1:], first + 1, operands, inline)),
    )
    return unpack(values, [aval.shape for aval in branches[0].out_avals])


def _is_up_to(b: Builder, index: Value, number: int) -> Value:
    """Return the condition `index <= number`, simplified for an index that was converted from a condition."""
    if index.op == "convert" and index.args[0].type == "b1":
        return b.apply("not", index.args[0])
    if index.type == "b1":
        return b.apply("not", index)
    return b.apply("le", index, b.constant(number, index.type))


def expand(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Append the primitives into which JAX expands another one (such as `jnp.searchsorted`); return the results."""
    primitive = equation.params["_prim"]
    shapes = [jax.ShapeDtypeStruct(atom.aval.shape, atom.aval.dtype) for atom in equation.invars]

    def expansion(*flat: Any) -> list[Any]:
        return jax.tree.leaves(primitive.expand(*jax.tree.unflatten(primitive.in_tree, flat)))

    return inline(jax.make_jaxpr(expansion)(*shapes), arrays)


def linear_solve(b: Builder, equation: Any, arrays: list[Values], inline: Inline) -> list[Values]:
    """Rule of `lax.custom_linear_solve`: append its solver, and return the solution.

    The primitive's other functions are for derivatives, and are not needed.
    """
    lengths, jaxprs = equation.params["const_lengths"], equation.params["jaxprs"]
    first = lengths.matvec + lengths.vecmat
    right_sides = arrays[sum(lengths) :]
    return inline(jaxprs.solve, [*arrays[first : first + lengths.solve], *right_sides])


def platform_index(b: Builder, equation: Any, arrays: list[Values]) -> Values:
    """Rule of `lax.platform_dependent`: return the index of the CPU version, or of the default version without one."""
    platforms = equation.params["platforms"]
    named = [k for k, names in enumerate(platforms) if names is not None and "cpu" in names]
    number = named[0] if named else platforms.index(None)
    return constant_array(b, jax.numpy.int32(number))
