"""Remove unused values from a program."""

from __future__ import annotations

from collections.abc import Iterable

from .ir import Branch, Call, Loop, Program, Region, Value, regions


def prune(program: Program) -> None:
    """Remove all values that no output and no store needs, in place.

    Carried values of loops and results of branches are removed as well.
    """
    _drop(program.body, _needed_values(program))


def _needed_values(program: Program) -> set[Value]:
    needed: set[Value] = set()
    pending: list[Value] = [value for output in program.outputs for value in output.values or ()]
    pending += [value for value in program.walk() if value.op == "store"]
    while pending:
        value = pending.pop()
        if value not in needed:
            needed.add(value)
            pending += _needs_of(value)
    return needed


def _needs_of(value: Value) -> Iterable[Value]:
    """Direct needs of a needed value."""
    if value.op == "param":
        loop = value.region.owner
        assert isinstance(loop, Loop)
        return loop, loop.args[value.data], loop.following[value.data]
    if value.op == "result":
        block = value.args[0]
        if isinstance(block, Loop):
            return block, block.params[value.data]
        if isinstance(block, Call):
            return (block,)
        assert isinstance(block, Branch)
        return block, block.yes[value.data], block.no[value.data]
    if isinstance(value, Loop):
        counter = () if value.turns is None else (value.turns, value.params[0])
        return *_blocks_around(value), value.condition, *counter
    if isinstance(value, Branch):
        return *_blocks_around(value), value.args[0]
    if value.op == "store":
        return *_blocks_around(value), *value.args
    return value.args


def _blocks_around(value: Value) -> tuple[Value, ...]:
    return () if value.region.owner is None else (value.region.owner,)


def _drop(region: Region, needed: set[Value]) -> None:
    region.values = [value for value in region.values if value in needed]
    places: dict[Value, dict[int, int]] = {}
    for value in region.values:
        if value.op == "result" and value.args[0] in places:
            value.data = places[value.args[0]][value.data]
        elif isinstance(value, Loop):
            places[value] = _drop_carried(value, needed)
        elif isinstance(value, Branch):
            left = {r.data for r in region.values if r.op == "result" and r.args[0] is value}
            kept = sorted(left)
            value.yes = tuple(value.yes[k] for k in kept)
            value.no = tuple(value.no[k] for k in kept)
            places[value] = {k: place for place, k in enumerate(kept)}
        for inner in regions(value):
            _drop(inner, needed)


def _drop_carried(loop: Loop, needed: set[Value]) -> dict[int, int]:
    kept = [k for k, param in enumerate(loop.params) if param in needed]
    loop.args = tuple(loop.args[k] for k in kept)
    loop.following = tuple(loop.following[k] for k in kept)
    loop.params = tuple(loop.params[k] for k in kept)
    places = {k: place for place, k in enumerate(kept)}
    for place, param in enumerate(loop.params):
        param.data = place
    return places
