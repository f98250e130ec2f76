"""Lines, code and stack of the law step of the scenarios at an arm's own rate, for docs/c-export.md.

python -m benchmarks.code_size
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import jax

from slidax.export.c_project import project
from slidax.export.c_structures import render
from slidax.scenarios import load

SCENARIOS = ("example-4.1", "example-4.1-1khz", "ur5e-payload", "panda-payload")
M7 = ("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb")
COMPILERS = {
    "Cortex-M7, `-Os`": ("arm-none-eabi-gcc", "-Os", *M7),
    "Cortex-M7, `-O2`": ("arm-none-eabi-gcc", "-O2", *M7),
    "x86-64, `-O2`": ("gcc", "-O2"),
}
NODE = re.compile(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes')
EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')


def main() -> None:
    """Prints the table."""
    jax.config.update("jax_enable_x64", True)
    print("| scenario | numbers | lines | compiler | code [B] | stack [B] | bound of it [B] |")
    print("|---|---|---:|---|---:|---:|---:|")
    for name in SCENARIOS:
        for single in (False, True):
            law = project(load(name), name="law", single=single, with_golden=False)
            with tempfile.TemporaryDirectory() as place:
                for template, ending in (("header.h.j2", ".h"), ("step.c.j2", ".c")):
                    (Path(place) / f"slidax_law{ending}").write_text(render(template, {"x": law}), encoding="utf-8")
                lines = len((Path(place) / "slidax_law.c").read_text(encoding="utf-8").splitlines())
                for compiler, command in COMPILERS.items():
                    if shutil.which(command[0]):
                        code, stack = _compiled(command, place)
                        numbers = f"{law.real}s | {lines:,} | {compiler} | {code:,} | {stack:,} | {law.stack:,}"
                        print(f"| `{name}` | {numbers} |", flush=True)


def _compiled(command: tuple[str, ...], place: str) -> tuple[int, int]:
    """Bytes of code and constants, and of the stack on the worst path through the calls."""
    law = ("-std=c99", "-ffp-contract=off", "-fcallgraph-info=su", "-c", "slidax_law.c", "-o", "law.o")
    subprocess.run([*command, *law], cwd=place, check=True)
    size = [command[0].replace("gcc", "size"), "law.o"]
    listing = subprocess.run(size, cwd=place, check=True, capture_output=True, text=True).stdout
    text = (Path(place) / "law.ci").read_text(encoding="utf-8")
    own = {name: int(size) for name, size in NODE.findall(text)}
    calls: dict[str, set[str]] = {}
    for caller, called in EDGE.findall(text):
        calls.setdefault(caller, set()).add(called)

    def below(name: str) -> int:
        return own.get(name, 0) + max((below(callee) for callee in calls.get(name, ())), default=0)

    return int(listing.splitlines()[1].split()[0]), below("slidax_law_step")


if __name__ == "__main__":
    main()
