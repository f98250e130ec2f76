"""Which values differ from run to run of a batch."""

from __future__ import annotations

from slidax.codegen.ir import Branch, Loop, Program, Region, Value


def varying(program: Program) -> set[Value]:
    """All values that depend on an input of which each run has its own, by their numbers or by how often they are made.

    What a loop carries from turn to turn is found by a fixed point: it is taken for the same in all runs until the
    contrary shows.

    - `program`: is only looked at.
    """
    found: set[Value] = set()
    known = -1
    while len(found) > known:
        known = len(found)
        _look(program, program.body, found)
    return found


def _look(program: Program, region: Region, found: set[Value]) -> None:
    for value in region.values:
        if isinstance(value, Loop):
            _look_at_loop(program, value, found)
        elif isinstance(value, Branch):
            _look(program, value.then, found)
            _look(program, value.otherwise, found)
        elif value not in found and _differs(program, value, found):
            found.add(value)


def _look_at_loop(program: Program, loop: Loop, found: set[Value]) -> None:
    for param, first, next in zip(loop.params, loop.args, loop.following, strict=True):
        # Runs that take different numbers of turns hold what others still change.
        if first in found or next in found or (loop.condition in found and next is not param):
            found.add(param)
    _look(program, loop.head, found)
    _look(program, loop.body, found)


def _differs(program: Program, value: Value, found: set[Value]) -> bool:
    if value.op == "input":
        return bool(program.inputs[value.data[0]].varying)
    if value.op == "result":
        block = value.args[0]
        if isinstance(block, Loop):
            return block.params[value.data] in found
        assert isinstance(block, Branch)
        return any(leaf in found for leaf in (block.args[0], block.yes[value.data], block.no[value.data]))
    if value.op == "load" and program.inputs[value.data].varying:
        return True
    return any(arg in found for arg in value.args)
