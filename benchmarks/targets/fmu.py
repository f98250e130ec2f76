"""The FMU: built for all platforms, judged by FMPy, moved by two importers and on other machines."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.targets import Row

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

SCENARIO = "example-4.1-1khz"
SECONDS = 5.0
CLOSE = 1e-9
"""Largest difference from our run, of positions [rad] and torques [N m]."""

NEEDED = {"ziglang": "ziglang", "fmpy": "fmpy", "libcosimpy": "libcosimpy"}


def rows(folder: Path) -> list[Row]:
    """The rows of the table.

    - `folder`: to work in.
    """
    missing = [package for module, package in NEEDED.items() if importlib.util.find_spec(module) is None]
    if missing:
        return [Row("FMU", missing=", ".join(missing))]
    import jax

    jax.config.update("jax_enable_x64", True)
    from benchmarks.targets import importers
    from slidax.export.fmu import export_fmu
    from slidax.scenarios import load

    scenario = load(SCENARIO)
    joints, period = scenario.controller.joints, scenario.period
    files = {fmi: folder / f"law{fmi}.fmu" for fmi in (3, 2)}
    exported = {fmi: export_fmu(scenario, file, name="law", fmi=fmi) for fmi, file in files.items()}
    ours = scenario.replace(t1=SECONDS).simulate().log
    compiler = f"zig {_zig()}"
    fmpy, libcosim = f"FMPy {version('fmpy')}", f"libcosimpy {version('libcosimpy')}"

    def moved(words: str, run_by: str, step: Callable[..., np.ndarray], remark: str) -> Row:
        log = importers.in_our_loop(scenario, step, SECONDS).log
        q, tau = (np.abs(a - b).max(1) for a, b in ((log.state.q, ours.state.q), (log.tau, ours.tau)))
        words_of = f"{remark}closed loop of {SECONDS:g} s: {q.max():.0e} rad, {tau.max():.0e} N m from our run"
        passed = int(((q <= CLOSE) & (tau <= CLOSE)).sum())
        return Row(words, compiler, run_by, passed, len(q), step=words_of)

    table = []
    for fmi, file in files.items():
        with importers.fmpy_steps(file, joints, period) as step:
            remark = f"validate: {_problems(file)}; "
            table.append(moved(f"FMU {fmi}.0, x86_64-linux, two-link arm", fmpy, step, remark))
    step = importers.libcosim_steps(files[2], joints, period)
    table.append(moved("FMU 2.0, x86_64-linux, two-link arm", libcosim, step, ""))
    return [*table, *_elsewhere(scenario, files[3], exported[3].project.guard, compiler, folder)]


def _elsewhere(scenario: Scenario, file: Path, guard: Any, compiler: str, folder: Path) -> list[Row]:
    """The binaries of other machines, fed with the samples of our run; what nothing here can run is built only."""
    from benchmarks.targets import importers
    from slidax.export.golden_samples import record_closed_loop

    run = record_closed_loop(scenario, guard, 0.2)
    table = []
    for platform, runner in (("x86_64-windows", "wine"), ("aarch64-linux", "qemu-aarch64")):
        words = f"FMU 3.0, {platform}, two-link arm"
        if lacking := importers.lacks(platform):
            table.append(Row(words, missing=lacking))
            continue
        place = folder / platform
        place.mkdir()
        tau = importers.by_host(file, run, scenario.period, platform, place)
        off = np.abs(tau - run.tau).max(1)
        remark = f"fed with {len(off)} samples of our run: {off.max():.0e} N m from it"
        table.append(
            Row(words, compiler, f"{runner} {_version(runner)}", int((off <= CLOSE).sum()), len(off), step=remark)
        )
    for platform in ("x86_64-darwin", "aarch64-darwin"):
        table.append(Row(f"FMU 3.0, {platform}, two-link arm", compiler, "built only, run by nobody"))
    return table


def _problems(file: Path) -> str:
    from fmpy.validation import validate_fmu

    problems = validate_fmu(str(file))
    return f"{len(problems)} problems" if problems else "clean"


def _zig() -> str:
    done = subprocess.run([sys.executable, "-m", "ziglang", "version"], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def _version(program: str) -> str:
    text = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
    return next((word for word in text.replace("-", " ").split() if word[0].isdigit()), "")
