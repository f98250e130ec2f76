"""Build and run every target that this machine has the tools for, and put the table into docs/targets.md."""

from __future__ import annotations

import argparse
import importlib
import re
import sys
import tempfile
from pathlib import Path

from benchmarks import machine
from benchmarks.targets import Row

PAGE = Path(__file__).resolve().parents[2] / "docs" / "targets.md"
MARK = re.compile(r"(<!-- table targets -->\n).*?(<!-- end -->)", re.DOTALL)
TARGETS = ("micro", "franka", "ros2", "fmu")
"""Modules beside this file, each with `rows(folder) -> list[Row]`."""


def main() -> None:
    """Print the table; write it into the page if no target is named."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.targets", description=__doc__)
    parser.add_argument("target", nargs="*", help=f"of {', '.join(TARGETS)}; all if none is named")
    names = parser.parse_args().target
    if unknown := set(names) - set(TARGETS):
        parser.error(f"no target is called {', '.join(sorted(unknown))}: there are {', '.join(TARGETS)}")
    rows: list[Row] = []
    for name in names or TARGETS:
        print(f"building and running {name} ...", file=sys.stderr)
        with tempfile.TemporaryDirectory() as folder:
            rows += importlib.import_module(f"benchmarks.targets.{name}").rows(Path(folder))
    table = "\n".join([*_table(rows), "", f"Machine: {machine.describe()}."])
    print(table)
    if not names:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(MARK.sub(lambda match: f"{match[1]}\n{table}\n\n{match[2]}", page), encoding="utf-8")


def _table(rows: list[Row]) -> list[str]:
    lines = [
        "| target | compiled by | run by | golden samples | code [B] | stack [B] | a step |",
        "|---|---|---|---:|---:|---:|---|",
    ]
    for row in rows:
        if row.missing:
            lines.append(f"| {row.target} | not on this machine: {row.missing} | | | | | |")
            continue
        samples = "" if row.samples is None else f"{row.passed} of {row.samples}"
        code, stack = ("" if size is None else f"{size:,}" for size in (row.code, row.stack))
        lines.append(f"| {row.target} | {row.compiled_by} | {row.run_by} | {samples} | {code} | {stack} | {row.step} |")
    return lines


if __name__ == "__main__":
    main()
