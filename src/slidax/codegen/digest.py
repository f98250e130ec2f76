"""Digest of a program: equal for equal programs in every process."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from .ir import FLOATS, Branch, Call, Loop, Program, Region, Value


def digest(program: Program) -> str:
    """Return a SHA-256 digest of a program and of this package's sources."""
    lines = [program.name] if program.name else []
    lines += [f"{entry.name} {entry.type} {entry.shape} {entry.varying}" for entry in program.inputs]
    numbers: dict[Value, int] = {}
    _describe(program.body, numbers, lines)
    for output in program.outputs:
        values = None if output.values is None else [numbers[value] for value in output.values]
        lines.append(f"{output.name} {output.type} {output.shape} {values}")
    whole = hashlib.sha256("\n".join(lines).encode())
    whole.update(_sources())
    return whole.hexdigest()


def _describe(region: Region, numbers: dict[Value, int], lines: list[str]) -> None:
    for value in region.values:
        args = [numbers[arg] for arg in value.args]
        numbers[value] = len(numbers)
        if isinstance(value, Loop):
            for param in value.params:
                numbers[param] = len(numbers)
            lines.append(f"loop {args}")
            _describe(value.head, numbers, lines)
            lines.append(f"while {numbers[value.condition]} {None if value.turns is None else numbers[value.turns]}")
            _describe(value.body, numbers, lines)
            lines.append(f"again {[numbers[carried] for carried in value.following]}")
        elif isinstance(value, Branch):
            lines.append(f"if {args}")
            for side, left in ((value.then, value.yes), (value.otherwise, value.no)):
                _describe(side, numbers, lines)
                lines.append(f"give {[numbers[result] for result in left]}")
        elif isinstance(value, Call):
            lines.append(f"call {args} {digest(value.program)}")
        else:
            data = value.data.hex() if value.op == "const" and value.type in FLOATS else value.data
            lines.append(f"{value.op} {value.type} {args} {data}")


@functools.cache
def _sources() -> bytes:
    """Digest of this package's sources: cached code is invalid once its printer changes."""
    whole = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        whole.update(path.read_bytes())
    return whole.digest()
