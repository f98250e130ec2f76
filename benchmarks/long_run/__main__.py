"""Print both tables of docs/c-export.md, each for the scenarios that are named."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

import jax
import numpy as np

from slidax.export.c_project import export_c
from slidax.scenarios import load

HERE = Path(__file__).parent
SCENARIOS = ("example-4.1-1khz", "example-4.2-1khz", "ur5e-payload", "panda-payload")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")
LINES = 10
"""Of a long run."""


def main() -> None:
    """Print the tables that the options name."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--steps", type=float, default=0, help="of a long run; none if not given")
    parser.add_argument(
        "--count", type=float, default=0, help="steps whose instructions are counted; none if not given"
    )
    options = parser.parse_args()
    if options.count:
        print("| scenario | steps | median | p99 | p99.9 | longest | over the median |")
        print("|---|---:|---:|---:|---:|---:|---:|")
    for name in options.scenarios:
        with tempfile.TemporaryDirectory() as place:
            program, resolution = built(name, Path(place))
            if options.count:
                print(f"| `{name}` | {_counted(program, round(options.count), resolution)} |", flush=True)
            if options.steps:
                _run_long(name, program, round(options.steps), resolution)


def built(name: str, folder: Path) -> tuple[Path, float]:
    """The program of a scenario, and the resolution of its encoders.

    - `name`: of the scenario.
    - `folder`: where it is built.
    """
    scenario = load(name)
    project = export_c(scenario, folder, name="law")
    numbers = [f"NUMBERS({member.name}, {member.size})" for member in project.memory if member.type == "f64"]
    (folder / "kept.h").write_text("\n".join(numbers) + "\n", encoding="utf-8")
    files = ["slidax_law.c", "slidax_law_scenario.c", str(HERE / "loop.c")]
    linked = ["-fno-inline-functions-called-once", "-static", "-I.", *files, "-o", "loop", "-lm"]
    subprocess.run(["gcc", *FLAGS, *linked], cwd=folder, check=True)
    return folder / "loop", float(np.max(getattr(scenario.plant.sensor, "resolution", 0.0)))


def counts(program: Path, steps: int, resolution: float) -> np.ndarray:
    """Return numbers of instructions, and of the steps that took them [_ 2].

    QEMU counts them, as an emulator of this machine's own processor.

    - `program`: from `built`.
    - `steps`: of the closed loop.
    - `resolution`: of the encoders.
    """
    plugin = program.parent / "count.so"
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", str(HERE / "count.c"), "-o", str(plugin)], check=True)
    emulator = shutil.which("qemu-x86_64")
    if emulator is None:
        raise SystemExit("qemu-x86_64 is not here: Debian's qemu-user has it")
    command = [emulator, "-cpu", "max", "-plugin", str(plugin), str(program), str(steps), str(steps), str(resolution)]
    listing = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return np.array([line.split() for line in listing.splitlines()], int)


def _counted(program: Path, steps: int, resolution: float) -> str:
    rows = counts(program, steps, resolution)
    # The first step computes what follows from the parameters alone.
    rows = rows[np.argsort(rows[:, 0])]
    shares = np.cumsum(rows[:, 1]) / rows[:, 1].sum()
    at = [int(rows[np.searchsorted(shares, share), 0]) for share in (0.5, 0.99, 0.999)]
    longest = int(rows[-1, 0])
    numbers = " | ".join(f"{number:,}" for number in (rows[:, 1].sum(), *at, longest))
    return f"{numbers} | {longest / at[0]:.2f}"


def _run_long(name: str, program: Path, steps: int, resolution: float) -> None:
    """One line for each tenth, and what the law keeps that is largest, in the first and in the last of them."""
    command = [str(program), str(steps), str(steps // LINES), str(resolution)]
    print(f"\n{name}, {steps:,} steps\n")
    print("| steps | torques that are not a number | status | largest error |\n|---:|---:|---:|---:|")
    kept: list[dict[str, float]] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        for line in running.stdout or ():
            count, bad, status, error, *numbers = line.split()
            print(f"| {int(count):,} | {bad} | {status} | {float(error):.3e} |", flush=True)
            kept.append({key: float(value) for key, value in (word.split("=") for word in numbers)})
    print("\n| what is kept | first tenth | second | last |\n|---|---:|---:|---:|")
    for key in kept[0]:
        print(f"| `{key}` | {kept[0][key]:.6g} | {kept[1][key]:.6g} | {kept[-1][key]:.6g} |")


if __name__ == "__main__":
    main()
