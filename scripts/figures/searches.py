"""Figures and tables of docs/studies.md."""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from slidax.report.figures import parameter_map, pareto_front
from slidax.report.figures.style import LINES, WIDTH, styled
from slidax.studies import RunOptions, read_study, study_of
from slidax.studies.cases import Cases
from slidax.studies.falsify import Falsify, FalsifyResult
from slidax.studies.sweep import Sweep, one_number
from slidax.studies.tune import Tune

from .shared import DOCS, ROOT, plain_numbers, save, table, write_table

STUDIES = ROOT / "examples" / "studies"
LABELS = {
    "robot.nominal.armature": "rotors that the law believes in  [kg m²]",
    "robot.plant.armature": "true rotors  [kg m²]",
    "robot.plant.load.mass": "payload  [kg]",
    "scheme.bound.margin": "u  [N m]",
}
UNLEARNT = {"scheme.sampled_data.adaptation": None}
MAPS: dict[str, tuple[str, dict[str, Any]]] = {
    "sweep-rotors-unlearnt": ("sweep-rotors", UNLEARNT),
    "sweep-rotors": ("sweep-rotors", {}),
    "sweep-payload": ("sweep-payload", {}),
}
"""By the name of the picture: the study's file, and what is changed of its scenario."""


def write_sweeps() -> None:
    """Run the sweeps of examples/studies, and draw them."""
    for name, (file, changes) in MAPS.items():
        study = read_study(STUDIES / f"{file}.yaml")
        assert isinstance(study, Sweep)
        result = study.model_copy(update={"changes": {**study.changes, **changes}}).run(RunOptions())
        axes = {LABELS[path]: one_number(axis) for path, axis in result.axes.items()}
        # A map without a bound in it shows nothing that the sentence does not say.
        if not result.good:
            save(parameter_map(axes, np.maximum(result.worst, -1.0), "least margin", 0.0), name)
        print(f"{name}: {result.summary}", flush=True)


RANDOM = 10_000


@dataclass(frozen=True)
class Seeded:
    """A scenario with a flaw that only shows itself in a corner of what is uncertain.

    - `name`: of its file in examples/studies, without `falsify-`.
    - `flaw`: in words.
    - `mended`: what takes the flaw away, as `changes` of the file.
    """

    name: str
    flaw: str
    mended: dict[str, Any]


SEEDED = (
    Seeded("weak-drives", "two-link arm, drives of 35 N m; mended: 60 N m", {"actuator.torque": 60}),
    Seeded("scara-drives", "SCARA, drives of 16.7 N m and N; mended: 20", {"actuator.torque": 20}),
    Seeded("weak-wrist", "Panda, a sixth drive of 5.75 N m; mended: 12 N m", {"actuator.torque": "robot"}),
)


SEEDED_HEAD = [
    "flaw",
    f"fail, of {RANDOM} random runs",
    "least margin",
    "fail, of a search",
    "first in run",
    "least margin",
    "time [s]",
    "fail, mended",
    "least margin",
]


def write_seeded_flaws() -> None:
    """Random cases, the search, and the search where the flaw is mended; the table of docs/studies.md."""
    rows = []
    for scenario in SEEDED:
        rows.append(seeded_row(scenario))
        print(rows[-1], flush=True)
    write_table("studies.md", "seeded", table(SEEDED_HEAD, rows))


def seeded_row(seeded: Seeded) -> list[str]:
    """One scenario's line of the table."""
    study = read_study(STUDIES / f"falsify-{seeded.name}.yaml")
    assert isinstance(study, Falsify)
    settings = study.model_dump(include={"scenario", "changes", "uncertainty"}, exclude_unset=True)
    random = study_of({**settings, "study": "monte_carlo", "runs": RANDOM}).run(RunOptions())
    begun = time.perf_counter()
    searched = study.run(RunOptions())
    took = time.perf_counter() - begun
    mended = study.model_copy(update={"changes": {**study.changes, **seeded.mended}}).run(RunOptions())
    failed = searched.table["outcome"] > 0
    return [
        seeded.flaw,
        f"{np.sum(random.table['outcome'] > 0)}",
        f"{np.min(random.table['margin']):.3f}",
        f"{searched.failures} of {searched.runs}",
        f"{np.argmax(failed) + 1 if searched.failures else '-'}",
        f"{_least(searched):.3f}",
        f"{took:.0f}",
        f"{mended.failures} of {mended.runs}",
        f"{_least(mended):.3f}",
    ]


def _least(searched: FalsifyResult) -> float:
    return float(np.nanmin(searched.table["margin"]))


FRICTION = {
    "robot.plant.coulomb": {"between": [0.0, 0.3], "each": "joint"},
    "robot.plant.viscous": {"between": [0.0, 0.2], "each": "joint"},
}
DISTURBANCE = {"disturbance.scale": {"between": [0.0, 1.0]}}
PAYLOAD = {"robot.plant.load.mass": {"between": [0.1, 2.0]}}
BUILT_IN: tuple[tuple[str, str, dict[str, Any], int], ...] = (
    ("example-4.1", "disturbance from none to the stated one", DISTURBANCE, 150),
    ("example-4.2", "the same", DISTURBANCE, 100),
    (
        "example-4.1-1khz",
        "also masses and inertias, 20 % either way from the law's values",
        {
            **DISTURBANCE,
            "robot.plant.masses": {"between": [[0.48, 1.44], [0.72, 2.16]]},
            "robot.plant.inertias": {"between": [4.8, 7.2], "each": "joint"},
        },
        1400,
    ),
    (
        "example-4.2-1khz",
        "also masses, 20 % either way",
        {**DISTURBANCE, "robot.plant.masses": {"between": [[1.92, 1.92, 0.96], [2.88, 2.88, 1.44]]}},
        1500,
    ),
    (
        "panda-payload",
        "payload 0.1 to 2 kg, mass ±15 %, Coulomb and viscous friction of each joint up to the scenario's",
        {**PAYLOAD, "robot.plant.mass_factor": {"between": [0.85, 1.15]}, **FRICTION},
        500,
    ),
    (
        "panda-pick",
        "payload 0.1 to 2 kg, mass ±5 %, friction likewise",
        {**PAYLOAD, "robot.plant.mass_factor": {"between": [0.95, 1.05]}, **FRICTION},
        160,
    ),
    (
        "panda-drop",
        "payload 0.1 to 2 kg, mass ±15 %, friction likewise",
        {**PAYLOAD, "robot.plant.mass_factor": {"between": [0.85, 1.15]}, **FRICTION},
        60,
    ),
    (
        "panda-table",
        "mass ±15 %, friction likewise, the table from half a millimetre in the way to just below the tip's way",
        {
            "robot.plant.mass_factor": {"between": [0.85, 1.15]},
            **FRICTION,
            "surroundings.table.height": {"between": [0.5303, 0.5308]},
        },
        60,
    ),
    (
        "ur5e-payload",
        "payload 0.1 to 3 kg, mass ±15 %, friction likewise",
        {
            "robot.plant.load.mass": {"between": [0.1, 3.0]},
            "robot.plant.mass_factor": {"between": [0.85, 1.15]},
            "robot.plant.coulomb": {"between": [0.0, 0.5], "each": "joint"},
            "robot.plant.viscous": {"between": [0.0, 0.3], "each": "joint"},
        },
        500,
    ),
)
"""Name, what is uncertain in words and as sets, and runs."""


def write_worst_cases() -> None:
    """Search each for its worst case, and write the table of docs/studies.md."""
    rows = []
    for name, words, sets, runs in BUILT_IN:
        result = study_of({"study": "falsify", "scenario": name, "uncertainty": sets, "runs": runs}).run(RunOptions())
        rows.append(
            [
                f"`{name}`",
                words,
                f"{result.runs}",
                f"{result.failures}",
                f"{float(np.nanmin(result.table['margin'])):.3f}",
            ]
        )
        print(rows[-1], flush=True)
    head = ["scenario", "what is uncertain", "runs", "fail", "least margin"]
    write_table("studies.md", "built-in", table(head, rows))


FRONT_HEAD = ["gains", "steady error [rad]", "steady torque step [N m]", "failed"]
FRONT_TICKS = {
    "panda-payload": ([50.0, 100.0, 200.0, 400.0], [0.1, 0.2, 0.4, 0.8]),
    "example-4.1-1khz": ([0.2, 0.4, 0.8], [0.05, 0.1, 0.15]),
}
FRONT_ROW = re.compile(r"^\| (today|front-\d+)(, best)? \| (\S+) \| (\S+) \|", re.MULTILINE)


def write_tune_fronts() -> None:
    """Run both searches for gains, and write their fronts as tables and pictures."""
    for name in FRONT_TICKS:
        study = read_study(STUDIES / f"tune-{name}.yaml")
        assert isinstance(study, Tune)
        result = study.run(RunOptions())
        rows = []
        for place in (None, *range(len(result.gains))):
            judged = result.judged(place)
            best = ", best" if place is not None and place == result.best else ""
            gains = "today" if place is None else f"front-{place + 1}{best}"
            rows.append(
                [gains, *(f"{value:.4g}" for value in judged.aims.values()), f"{judged.failures} of {judged.runs}"]
            )
        write_table("studies.md", f"tune-{name}", table(FRONT_HEAD, rows))
        draw_front(name)
        print(f"{name}: {result.summary}", flush=True)
        for aim in result.aims:
            change = result.difference(result.best or 0, aim)
            ends = "" if change.of_mean is None else f", {change.of_mean.lower:.2g} to {change.of_mean.upper:.2g}"
            print(f"  best less today, {aim}: {change.mean:.3g}{ends}", flush=True)


def draw_front(name: str) -> None:
    """The picture of the table on the page."""
    page = (DOCS / "studies.md").read_text(encoding="utf-8")
    rows = FRONT_ROW.findall(page.partition(f"<!-- table tune-{name} -->")[2].partition("<!-- end -->")[0])
    numbers = {gains: [1e6 * float(error), float(step)] for gains, _, error, step in rows}
    today = np.array(numbers.pop("today"))
    best = next((k for k, gains in enumerate(numbers) if (gains, ", best") in [row[:2] for row in rows]), None)
    labels = ["steady error  [µrad]", "steady torque step  [N m]"]
    figure = pareto_front(labels, np.array(list(numbers.values())), today, best)
    plain_numbers(figure.axes[0], *FRONT_TICKS[name])
    save(figure, f"tune-{name}")


def time_study(name: str, runs: int, folder: Path) -> tuple[float, float, dict]:
    """Seconds, peak memory [MB] and the answer of a whole `slidax study`."""
    out = folder / f"{name}-{runs}"
    words = ["study", str(STUDIES / f"{name}.yaml"), "--runs", str(runs), "--out", str(out), "--json"]
    code = "import sys, resource; from slidax.cli import app\n"
    code += (
        "try: app(sys.argv[1:])\nfinally: print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)"
    )
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - started
    answer = json.loads(done.stdout)
    answer["bytes_per_row"] = (out / "rows.parquet").stat().st_size / runs
    return seconds, float(done.stderr.split()[-1]) / 1e3, answer


def time_over_engine(name: str, chunks: int) -> float:
    """Time of a study's rows over that of the bare engine's batches of the same values; the median of all chunks."""
    study = read_study(STUDIES / f"{name}.yaml")
    family = study.family()
    runner = study.runner(family, RunOptions())
    cases = Cases(family)
    (loop,) = [cases._loop((), study.values(family, 0, 2)) for _ in [cases._groups(study.values(family, 0, 2), 2)]]
    ratios = []
    for k in range(chunks + 1):
        values = study.values(family, k * runner.chunk, runner.chunk)
        times = []
        for whole in (True, False):
            started = time.perf_counter()
            if whole:
                list(runner.stream(iter([(0, values)])))
            else:
                loop.simulated(values, None, None)
            times.append(time.perf_counter() - started)
        ratios.append(times[0] / times[1])
    return float(np.median(ratios[1:]))


@styled
def draw_cost(curves: dict[str, tuple[list[int], list[float]]]) -> Figure:
    """Time per run over the number of runs."""
    figure = Figure(figsize=(0.62 * WIDTH, 2.4), layout="constrained")
    axes = figure.subplots()
    for look, (name, (runs, seconds)) in zip(LINES, curves.items(), strict=False):
        axes.plot(
            runs,
            [1e3 * s / n for s, n in zip(seconds, runs, strict=True)],
            marker="o",
            markersize=3,
            label=name,
            **look,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("runs")
    axes.set_ylabel("time per run  [ms]")
    axes.margins(x=0.05)
    axes.legend()
    return figure


def measure_studies() -> None:
    """Measure the speed of studies: the table of docs/studies.md and its figure, docs/figures/study-cost.svg.

    Each command is timed in a process of its own; the time of a run relative to the bare engine is measured in one
    process, in turns.
    """
    parser = argparse.ArgumentParser(description=measure_studies.__doc__)
    parser.add_argument("--small", action="store_true", help="a hundredth of the cases")
    fewer = 100 if parser.parse_args().small else 1
    plans = {"panda-payload": [1000, 10000], "example-4.1-1khz": [1000, 10000, 100000]}
    curves = {}
    print("| study | runs | whole command [s] | runs/s | over the bare engine | memory [MB] | bytes a row |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as folder:
        for name, numbers in plans.items():
            ratio = time_over_engine(name, 3)
            curves[name] = ([], [])
            for runs in [max(number // fewer, 64) for number in numbers]:
                seconds, memory, answer = time_study(name, runs, Path(folder))
                curves[name][0].append(runs)
                curves[name][1].append(seconds)
                print(
                    f"| `{name}` | {runs:,} | {seconds:.1f} | {runs / seconds:.0f} | {ratio:.2f} | {memory:.0f} "
                    f"| {answer['bytes_per_row']:.0f} |",
                    flush=True,
                )
                print(f"  {answer['failures']} failed; at least {answer['probability']['lower']:.5f}", file=sys.stderr)
    save(draw_cost(curves), "study-cost")
