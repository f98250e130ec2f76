"""Find the values that differ between the runs of a batch."""

from __future__ import annotations

from slidax.codegen.ir import Branch, Loop, Program, Region, Value


def varying(program: Program) -> set[Value]:
    """Return all values that depend on a varying input, directly or by the number of loop turns.

    Values that a loop carries need a fixed-point iteration: they count as uniform until a pass shows the contrary.
    """
    differing: set[Value] = set()
    count = -1
    while len(differing) > count:
        count = len(differing)
        _visit(program, program.body, differing)
    return differing


def _visit(program: Program, region: Region, differing: set[Value]) -> None:
    for value in region.values:
        if isinstance(value, Loop):
            _visit_loop(program, value, differing)
        elif isinstance(value, Branch):
            _visit(program, value.then, differing)
            _visit(program, value.otherwise, differing)
        elif value not in differing and _differs(program, value, differing):
            differing.add(value)


def _visit_loop(program: Program, loop: Loop, differing: set[Value]) -> None:
    for param, first, next in zip(loop.params, loop.args, loop.following, strict=True):
        # Runs that take different numbers of turns hold what others still change.
        if first in differing or next in differing or (loop.condition in differing and next is not param):
            differing.add(param)
    _visit(program, loop.head, differing)
    _visit(program, loop.body, differing)


def _differs(program: Program, value: Value, differing: set[Value]) -> bool:
    if value.op == "input":
        return bool(program.inputs[value.data[0]].varying)
    if value.op == "result":
        block = value.args[0]
        if isinstance(block, Loop):
            return block.params[value.data] in differing
        assert isinstance(block, Branch)
        return any(leaf in differing for leaf in (block.args[0], block.yes[value.data], block.no[value.data]))
    if value.op == "load" and program.inputs[value.data].varying:
        return True
    return any(arg in differing for arg in value.args)
