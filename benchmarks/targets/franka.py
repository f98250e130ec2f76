"""The law of panda-payload on franka-sim, with everything enforced, and what faults end with."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.targets import Row
from slidax import scenarios
from slidax.export.onboard.pilot import CompiledLaw, MotionLog
from slidax.export.onboard.rehearsal import RehearsalArm, read, rehearse, replay
from slidax.export.robots import export_franka

from . import franka_chain

SCENARIO = "panda-payload"
PATH = {"hold": 1.0, "small": 1.0, "widen": 2.0, "motion": 10.0}
"""The motion of franka_faults.py."""


def rows(folder: Path) -> list[Row]:
    """The rows of the table; measurements are printed in full, as the table has few columns.

    - `folder`: for what is made.
    """
    name, plain = "Franka, program in Python", "Franka, program in C++"
    if reason := franka_chain.missing():
        return [Row(name, missing=reason), Row(plain, missing=reason)]
    import jax

    jax.config.update("jax_enable_x64", True)
    scenario = scenarios.load(SCENARIO)
    export_franka(scenario, folder, name="law")
    law = CompiledLaw(folder / "law")
    with franka_chain.serving(scenario, folder):
        results = {fault: franka_chain.moved_in_time(folder, fault) for fault in franka_chain.FAULTS}
        in_cpp = _in_cpp(folder)
    for fault, result in results.items():
        print(
            f"{fault}: {result['ending']} in phase {result['phase']}: {result['outcome']}; "
            f"{result['periods']} periods, largest error {result['largest_error']:.1e} rad, "
            f"moved {result['moved_after']:.1e} rad after it, "
            f"success rate at least {result['success_rate']:.2f}, attempts {result['attempts']}"
        )
    print(compared(law, folder / "none.csv"))
    good, samples = results["none"], _golden(folder)
    compiler = _version(["cc", "--version"])
    return [
        Row(
            name,
            compiled_by=compiler,
            run_by="pylibfranka, franka-sim",
            passed=samples,
            samples=samples,
            step=f"{good['periods']} periods, {good['ending']}, success rate {good['success_rate']:.2f}",
        ),
        Row(plain, compiled_by=compiler, run_by="libfranka, franka-sim", step=in_cpp)
        if in_cpp
        else Row(plain, missing="libfranka: set Franka_DIR to where its FrankaConfig.cmake is"),
    ]


def _golden(folder: Path) -> int:
    """Number of golden samples, all of which the step passes: it is an error if one fails."""
    law = folder / "law"
    subprocess.run(["cmake", "-S", law, "-B", law / "build"], check=True, capture_output=True)
    subprocess.run(["cmake", "--build", law / "build", "-t", "test_law"], check=True, capture_output=True)
    done = subprocess.run([law / "build" / "test_law"], check=True, capture_output=True, text=True)
    return int(done.stdout.split()[0])


def _in_cpp(folder: Path) -> str:
    """The C++ program with libfranka itself, if that is here: its report of a motion as above."""
    if "Franka_DIR" not in os.environ:
        return ""
    build = folder / "build"
    subprocess.run(["cmake", "-S", folder, "-B", build], check=True, capture_output=True)
    subprocess.run(["cmake", "--build", build], check=True, capture_output=True)
    options = [word for name, value in PATH.items() for word in (f"--{name}", str(value))]
    command = [str(build / "main"), "127.0.0.1", "--no-realtime", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    print(done.stdout.strip())
    ending, counted = done.stdout.splitlines()[:2]
    return f"{counted.partition(' periods')[0]} periods, {ending.split()[0]}, {counted.partition('; ')[2]}"


def compared(law: CompiledLaw, log: Path) -> str:
    """Compare a log with the rehearsal from the same posture, and with its own replay through the law.

    - `law`: that made it.
    - `log`: of a whole motion.
    """
    theirs = read(log)
    start = [theirs[0][f"q_wanted_{k}"] for k in range(1, law.joints + 1)]
    pilot, own = law.pilot(), MotionLog(law)
    _set(pilot)
    rehearse(pilot, RehearsalArm(law, start), own)
    again = law.pilot()
    _set(again)
    bits = replay(again, theirs)
    ours = {round(1e3 * row[0]): dict(zip(own.columns, row, strict=True)) for row in own.rows}
    both = [(ours[at], row) for row in theirs if (at := round(1e3 * row["time"])) in ours]
    lines = []
    for name, unit in (("q", "rad"), ("tau", "N m")):
        columns = [f"{name}_{k}" for k in range(1, law.joints + 1)]
        off = np.array([[a[column] - b[column] for column in columns] for a, b in both])
        lines.append(f"{name} differs by {np.abs(off).max():.1e} {unit} at most, {np.sqrt((off**2).mean()):.1e} rms")
    return f"compared with the rehearsal, {'; '.join(lines)}; through the law again: torques differ by {bits:g} N m"


def _set(pilot: object) -> None:
    for name, value in PATH.items():
        setattr(pilot.options.path, name, value)  # type: ignore[attr-defined]


def _version(command: list[str]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[0]
