"""The table of docs/your-own-law.md: laws of the literature as users write them, and their C."""

from __future__ import annotations

import ast
import inspect
import tempfile
import textwrap
import time
from pathlib import Path

import numpy as np

from examples.own_laws import LAWS
from slidax import scenarios
from slidax.analysis import steady_error
from slidax.export import export_c
from slidax.export.golden_samples import answer, random_samples
from slidax.scenarios import Scenario
from tests.export.exported import Exported

from .shared import write_table

SOURCES = {
    "PDPlus": "PD+ (Paden and Panja, 1988)",
    "IntegralSlidingMode": "integral sliding mode (Utkin and Shi, 1996)",
    "TimeDelayControl": "time-delay control (Youcef-Toumi and Ito, 1990)",
    "Rise": "RISE (Xian and others, 2004)",
    "L1Adaptive": "L1 adaptive control (Hovakimyan and Cao, 2010)",
    "LinearDisturbanceRejection": "linear disturbance rejection, LADRC (Gao, 2003)",
    "MomentumObserver": "computed torque with a momentum observer (De Luca and Mattone, 2003)",
    "AdaptiveSlotineLi": "adaptive control with a regressor (Slotine and Li, 1987)",
    "AdaptiveSuperTwisting": "adaptive super-twisting (Shtessel, Taleb and Plestan, 2012)",
    "BarrierSuperTwisting": "super-twisting with a barrier (Obeid and others, 2020)",
    "SampledFunnel": "sampled funnel control (Lanza and others, 2024)",
    "PrescribedTime": "prescribed time and accuracy (Cao, Cao and Song, 2021)",
}


def write_own_laws() -> None:
    """Simulate and export each law in example 4.1 at 1 kHz, and compare its C with Python on 2000 random samples."""
    rows = [
        "| law | lines of code | time to the C project | difference of C and Python | steady error |",
        "|---|---|---|---|---|",
    ]
    for law in LAWS:
        scenario = scenarios.load("example-4.1-1khz", {"simulation.t1": 5.0})
        scenario = scenario.replace(controller=law(scenario.controller.nominal))
        error = float(np.max(np.asarray(steady_error(scenario.simulate()))))
        with tempfile.TemporaryDirectory() as folder:
            started = time.perf_counter()
            export_c(scenario, Path(folder, "project"), name="law")
            seconds = time.perf_counter() - started
            difference = largest_difference(scenario, Path(folder))
        measured = f"{seconds:.1f} s | {difference:.1g} | {1e3 * error:.2g} mrad"
        rows.append(f"| {SOURCES[law.__name__]} | {lines_of(law)} | {measured} |")
    write_table("your-own-law.md", "laws", "\n".join(rows))


def lines_of(law: type) -> int:
    """Lines of code, without the docstring and blank lines."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(law)))
    (body,) = tree.body
    assert isinstance(body, ast.ClassDef)
    code = body.body[1:] if ast.get_docstring(body) else body.body
    return 1 + len({line for part in code for line in range(part.lineno, (part.end_lineno or part.lineno) + 1)})


def largest_difference(scenario: Scenario, folder: Path) -> float:
    """Largest difference of the torques in C and Python, relative to the largest torque of the sample."""
    exported = Exported(scenario, folder)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=3)
    expected = np.asarray(answer(guard, samples)[0].tau)
    difference = np.abs(exported.answers(samples).command["tau"] - expected).max(1)
    return float((difference / np.abs(expected).max(1)).max())
