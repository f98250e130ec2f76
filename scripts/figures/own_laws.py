"""Laws of the literature: the table of docs/your-own-law.md, and the fronts of docs/benchmark-of-schemes.md."""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import tempfile
import textwrap
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from examples.own_laws import LAWS
from slidax import scenarios
from slidax.analysis import steady_error
from slidax.export import export_c
from slidax.export.golden_samples import answer, random_samples
from slidax.report.figures.style import LINES, NARROW, WIDTH, styled
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter_description, read_description
from slidax.scenarios.uncertainty import Uncertainty
from slidax.simulation import Run
from slidax.studies.benchmark.entries import BenchmarkEntry, GainDescription, Gains
from slidax.studies.cases import Cases, Values, points
from slidax.studies.pareto import FrontEvaluation, non_dominated, pareto_search
from slidax.studies.tune import point_of_own_values
from tests.export.exported import Exported

from .arm_learning import RATED, ideal_torque
from .shared import plain_numbers, save, table, write_table

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


PAGE = "benchmark-of-schemes.md"
PATH = "examples.own_laws"
"""Where the laws are, for scenario files."""

TOLERANCE = {
    "performance": {"kind": "fixed_time", "initial": 1.0, "final": 0.005, "deadline": 2.0, "exponent": 2.01},
    "overshoot": 0.3,
}
"""Of every law; also the envelope of those that have one."""

PUSH, PUSHED, END = 0.06, 5.0, 8.0
"""Share of the rated torque on all joints for 0.1 s, when it begins, and when a run ends [s]."""

CHANGES: dict[str, Any] = {
    "tolerance": TOLERANCE,
    "disturbance": {
        "scale": 0.0,
        "terms": [{"kind": "step", "value": (PUSH * RATED).tolist(), "start": PUSHED, "end": PUSHED + 0.1}],
    },
    "simulation.substeps": 5,
}
"""Of `panda-payload`, for every law."""

UNKNOWN: dict[str, Any] = {
    "robot.plant.mass_factor": {"between": [0.8, 1.2]},
    "robot.plant.load.mass": {"between": [0.05, 3.0]},
    "robot.plant.armature": {"between": [0.03, 0.25], "distribution": "log_uniform", "each": "joint"},
    "robot.plant.coulomb": {"between": [0.1, 0.6], "each": "joint"},
    "robot.plant.viscous": {"between": [0.05, 0.4], "each": "joint"},
    "disturbance.scale": {"between": [0.0, 1.0]},
}
"""Sets of values in the worst cases; the last one is for the push."""

OWN = {
    "robot.plant.mass_factor": 0.85,
    "robot.plant.load.mass": 2.0,
    "robot.plant.armature": [0.1] * 7,
    "robot.plant.coulomb": [0.3] * 7,
    "robot.plant.viscous": [0.2] * 7,
    "disturbance.scale": 0.0,
}
"""The values of `panda-payload` itself, for which gains are tuned."""

LIMITS = {"limit": RATED.tolist()}
_Sets: TypeAdapter[Uncertainty] = TypeAdapter(Uncertainty)
FIXED: dict[str, dict[str, Any]] = {
    "TimeDelayControl": {"interval": 1e-3, **LIMITS},
    "Rise": LIMITS,
    "L1Adaptive": {"interval": 1e-3, "bound": 1000.0},
    "LinearDisturbanceRejection": {"interval": 1e-3, **LIMITS},
    "MomentumObserver": LIMITS,
    "SampledFunnel": {"initial": 1.0, "final": 0.005, "deadline": 2.0, "exponent": 2.01},
    "PrescribedTime": {
        "bound": 1.0,
        "accuracy": 0.005 * 7**0.5,
        "deadline": 2.0,
        "speed": 3.0,
        "activity": 0.65,
        "model": 1.0,
    },
}
"""Values that are not tuned: data of the arm, the sample time and the envelope."""

DENSITY = {"sampled_data.estimator.torque_density": GainDescription(between=(0.001, 0.5))}
"""Tuned for every law, as part of what all of them have."""

LABELS = {
    "PDPlus": "PD+",
    "IntegralSlidingMode": "integral sliding mode",
    "TimeDelayControl": "time-delay control",
    "Rise": "RISE",
    "L1Adaptive": "L1",
    "LinearDisturbanceRejection": "LADRC",
    "MomentumObserver": "momentum observer",
    "AdaptiveSlotineLi": "adaptive Slotine-Li",
    "AdaptiveSuperTwisting": "adaptive super-twisting",
    "BarrierSuperTwisting": "barrier super-twisting",
    "SampledFunnel": "sampled funnel",
    "PrescribedTime": "prescribed time",
}
RIVALS = (
    *("cftsmppc", "super_twisting", "slotine_li", "slotine_li_ppc", "computed_torque", "nftsmc", "ftsmc", "pid"),
    *LABELS,
)
"""Schemes of the package, and classes of examples/own_laws.py."""

FIRST = 104
"""Runs of the first batch: so many are worth optimised machine code, which is then compiled once."""

SEEDS, ARMS = 3, 20
LEVELS, CHOSEN = (0.01, 0.03, 0.1), 0.03
"""N m: noise at which errors are compared, and that of the worst cases."""

IN_README = ("IntegralSlidingMode", "ftsmc", "cftsmppc", "super_twisting", "MomentumObserver", "computed_torque")
"""Laws of the README's table: the best known, and every rival that has the least error at one of the levels."""

BANDWIDTH = 50.0
"""Hz: what is above it counts as chattering."""

SETTLED = 1e-3
"""rad: a fifth of the envelope, from which a push is over."""


@cache
def ideal_steps(t1: float) -> np.ndarray:
    """Steps of the ideal torque over the second half of a run [samples n], the same for all laws."""
    scenario = scenarios.load("panda-payload")
    times = np.arange(round(0.5 * t1 / scenario.period), round(t1 / scenario.period) + 1) * scenario.period
    return np.diff(ideal_torque(scenario, times), axis=0)


@dataclass
class Rival:
    """A law on `panda-payload`, and the runs that tell its error and its noise.

    - `family`: the scenarios with its gains and what varies in the worst cases.
    - `cases`: runs them.
    - `ideal`: steps of the ideal torque over the steady time [samples n].
    - `first`: least number of runs of the next batch.
    """

    family: Family
    cases: Cases
    ideal: np.ndarray
    first: int = FIRST

    @classmethod
    def of(cls, name: str, t1: float = END) -> Rival:
        """The law by its name in `RIVALS`."""
        scheme = f"{PATH}:{name}" if name in LABELS else name
        entry = BenchmarkEntry(scheme, "sampled-data")
        gains, fixed = entry.gains(), FIXED.get(name, {})
        tuned = {path: gain for path, gain in gains.tuned.items() if path not in fixed} | DENSITY
        if name == "PrescribedTime":
            # There torques are counted in M̄, which follows the joints here.
            tuned["k2"] = GainDescription(between=(0.5, 450.0))
            tuned["inertia"] = GainDescription(between=(0.1, 10.0), times="inertia")
        base = alter_description(
            read_description("panda-payload"),
            {"scheme.name": scheme, **CHANGES, "simulation.t1": t1}
            | {f"scheme.{path}": value for path, value in {**gains.fixed, **fixed}.items()},
        )
        family = Family.of(base, _Sets.validate_python(UNKNOWN), Gains(tuned, {}).sets(base))
        return cls(family, Cases(family, threads=1, name=name), ideal_steps(t1))

    def values(self, cube: np.ndarray, unknown: Values) -> Values:
        """Values of cases by path: of each gain point, or of the only one for each case."""
        gains = self.family.varied.values(np.clip(cube, 0.0, np.nextafter(1.0, 0.0)))
        rows = max(len(cube), len(next(iter(unknown.values()))))
        both = {**{path: np.asarray(array) for path, array in unknown.items()}, **gains}
        return {path: np.broadcast_to(array, (rows, *array.shape[1:])) for path, array in both.items()}

    def judge(self, cube: np.ndarray) -> FrontEvaluation:
        """Error and noise of gains, and by how much they leave the tolerance band."""
        own = {path: np.asarray(value, float)[None] for path, value in OWN.items()}
        rows = np.concatenate([cube, np.repeat(cube[:1], max(self.first - len(cube), 0), axis=0)])
        self.first = 0
        run = self.cases.batch(self.values(rows, own), 1)
        error, noise = (value[: len(cube)] for value in self.measured(run))
        outside, kind = np.asarray(run.tally.tolerance.outside)[: len(cube)], np.asarray(run.fault.kind)[: len(cube)]
        fine = np.isfinite(error) & np.isfinite(noise) & (kind == 0)
        aims = np.where(fine[:, None], np.maximum(np.stack([error, noise], axis=1), 1e-9), 1e3)
        return FrontEvaluation(aims, np.where(fine, outside / 100.0, 1e3))

    def measured(self, run: Run) -> tuple[np.ndarray, np.ndarray]:
        """Largest error [rad], and root mean square of torque steps less the ideal ones [N m], of the worst joint."""
        error, tau = np.asarray(run.log.e), np.asarray(run.log.tau)
        first = error.shape[1] - len(self.ideal) - 1
        noise = np.diff(tau[:, first:], axis=1) - self.ideal
        return np.abs(error[:, first:]).max(axis=(1, 2)), np.sqrt((noise**2).mean(axis=1)).max(axis=1)

    def worst(self, cube: np.ndarray, arms: int) -> dict[str, Any]:
        """Random arms, the spectrum and a push under one set of gains."""
        drawn = self.family.uncertain.values(points(11, 0, arms, self.family.uncertain.dimensions))
        own = {path: np.broadcast_to(value, (2, *np.shape(value))) for path, value in OWN.items()}
        drawn |= {"disturbance.scale": np.zeros(arms)}
        own |= {"disturbance.scale": np.array([0.0, 1.0])}
        both = {path: np.concatenate([array, own[path]]) for path, array in drawn.items()}
        run = self.cases.batch(self.values(cube, both), 1)
        error, tau = np.abs(np.asarray(run.log.e)), np.asarray(run.log.tau)
        outside, first = np.asarray(run.tally.tolerance.outside), error.shape[1] - len(self.ideal) - 1
        largest = error[:arms, first:].max(axis=(1, 2))
        pushed, period = error[-1].max(axis=1), self.family.base.simulation.period
        late = np.flatnonzero(pushed > SETTLED)
        settled = 0.0 if not len(late) else (late[-1] + 1) * period - PUSHED
        return {
            "inside": int(np.sum((outside[:arms] == 0) & np.isfinite(largest))),
            "median": float(np.median(np.where(np.isfinite(largest), largest, np.inf))),
            "largest": float(np.max(np.where(np.isfinite(largest), largest, np.inf))),
            "chattering": share_above(tau[arms, first:], period),
            "peak": float(pushed[round(PUSHED / period) :].max(initial=0.0)),
            "outside": int(outside[-1]),
            "settled": max(float(settled), 0.0) if settled < END - PUSHED else float("inf"),
        }


def share_above(tau: np.ndarray, period: float) -> float:
    """Share of the torque's power above `BANDWIDTH`, without its mean, of the worst joint."""
    window = np.hanning(len(tau))[:, None]
    power = np.abs(np.fft.rfft((tau - tau.mean(axis=0)) * window, axis=0)) ** 2
    above = np.fft.rfftfreq(len(tau), period) > BANDWIDTH
    return float((power[above].sum(axis=0) / power.sum(axis=0)).max())


def front_of(name: str, candidates: int, seeds: int, arms: int, t1: float) -> dict[str, Any]:
    """The fronts of a law by seed, and its worst cases at the least error up to `CHOSEN`."""
    started = time.perf_counter()
    rival = Rival.of(name, t1)
    dimension = rival.family.varied.dimensions
    start = np.clip(point_of_own_values(rival.family.varied), 0.02, 0.98)
    fronts, cubes = [], []
    for seed in range(seeds):
        front = pareto_search(rival.judge, dimension, evaluations=candidates, start=start, seed=seed, most=40)
        fronts.append(front.aims.tolist())
        cubes.append(front.points.reshape(-1, dimension))
    aims = np.concatenate([np.reshape(front, (-1, 2)) for front in fronts])
    result: dict[str, Any] = {"fronts": fronts, "dimension": dimension, "candidates": candidates}
    if len(aims):
        quiet = aims[:, 1] <= CHOSEN
        chosen = int(np.argmin(np.where(quiet, aims[:, 0], np.inf) if quiet.any() else aims[:, 1]))
        cube = np.concatenate(cubes)[chosen][None]
        result |= {"chosen": aims[chosen].tolist(), "worst": rival.worst(cube, arms)}
        result["gains"] = {path: array[0].tolist() for path, array in rival.family.varied.values(cube).items()}
    return {**result, "seconds": time.perf_counter() - started}


def write_rival_fronts() -> None:
    """Tune each law for error against torque noise on `panda-payload`; write the tables and the picture."""
    parser = argparse.ArgumentParser(description=write_rival_fronts.__doc__)
    parser.add_argument("--kept", type=Path, required=True, help="folder of the results, where the command goes on")
    parser.add_argument("--candidates", type=int, default=240, help="sets of gains for each seed")
    parser.add_argument("--only", nargs="*", default=RIVALS, metavar="LAW", help="some laws; no tables are written")
    parser.add_argument("--small", action="store_true", help="short runs with one seed and two arms: that it works")
    parser.add_argument("--tables", action="store_true", help="write the tables of the results that are kept")
    arguments = parser.parse_args()
    if arguments.tables:
        write_kept(arguments.kept)
        return
    scenarios.allow_code()
    arguments.kept.mkdir(parents=True, exist_ok=True)
    for name in arguments.only:
        path = arguments.kept / f"{name}.json"
        if path.exists():
            continue
        if arguments.small:
            result = front_of(name, 8, 1, 2, 0.2)
        else:
            result = front_of(name, arguments.candidates, SEEDS, ARMS, END)
        path.write_text(json.dumps(result, indent=1), encoding="utf-8")
        print(f"{name}: {result.get('chosen')}, {result['seconds']:.0f} s", flush=True)
    if arguments.only == RIVALS and not arguments.small:
        write_kept(arguments.kept)


def write_kept(folder: Path) -> None:
    """Write the tables and the picture of the results in a folder."""
    kept = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*.json")}
    results = dict(sorted(kept.items(), key=lambda item: [error_at(item[1]["fronts"], level) for level in LEVELS[1:]]))
    write_fronts(results)
    write_worst_of_rivals(results)
    write_readme_fronts(results)
    save(draw_rival_fronts(results), "rival-fronts")


def error_at(fronts: list[list[list[float]]], level: float) -> float:
    """Least error of some fronts at a noise up to a level; infinite if they have none."""
    return min((error for front in fronts for error, noise in front if noise <= level), default=float("inf"))


def label(name: str) -> str:
    """The law in tables."""
    return LABELS.get(name, f"`{name}`")


def number(value: float) -> str:
    """An error in two digits; a dash if there is none, and `lost` if it is larger than a turn."""
    return "-" if not np.isfinite(value) else "lost" if value > 2.0 * np.pi else f"{value:.1e}"


def write_fronts(results: dict[str, Any]) -> None:
    """The table of errors at each noise, of all seeds together and from the best to the worst seed."""
    rows = []
    for name, result in results.items():
        fronts = result["fronts"]
        seeds = [error_at([front], CHOSEN) for front in fronts]
        least = min((error for front in fronts for error, _ in front), default=float("inf"))
        errors = [number(error_at(fronts, level)) for level in LEVELS]
        rows.append(
            [
                label(name),
                *errors,
                number(least),
                f"{number(min(seeds))} to {number(max(seeds))}" if np.isfinite(min(seeds)) else "-",
            ]
        )
    levels = [f"error [rad] at {level:g} N m" for level in LEVELS]
    head = ["law", *levels, "least error", f"seeds, at {CHOSEN:g} N m"]
    missing = ", ".join(label(name) for name in RIVALS if name not in results)
    note = f"\n\nNot measured yet, for want of computing time: {missing}." if missing else ""
    write_table(PAGE, "rival-fronts", table(head, rows) + note)


def write_worst_of_rivals(results: dict[str, Any]) -> None:
    """The table of worst cases, spectrum and push."""
    rows = []
    for name, result in results.items():
        if "worst" not in result:
            rows.append([label(name), *["-"] * 8])
            continue
        worst, (error, noise) = result["worst"], result["chosen"]
        settled = f"{worst['settled']:.2f} s" if np.isfinite(worst["settled"]) else "never"
        rows.append(
            [
                label(name),
                f"{number(error)} at {noise:.3f}",
                f"{worst['inside']} of {ARMS}",
                number(worst["median"]),
                number(worst["largest"]),
                number(worst["chattering"]),
                number(worst["peak"]),
                f"{worst['outside']}",
                settled,
            ]
        )
    head = [
        "law",
        "error [rad] at noise [N m]",
        "random arms inside",
        "median error",
        "largest error",
        "power above 50 Hz",
        "peak after a push [rad]",
        "samples outside",
        "within 1e-3 rad after",
    ]
    write_table(PAGE, "rival-worst", table(head, rows))


def write_readme_fronts(results: dict[str, Any]) -> None:
    """The README's table: some laws' error at each noise, and the random arms inside with the gains of one arm."""
    rows = []
    for name in IN_README:
        result = results[name]
        errors = [number(error_at(result["fronts"], level)) for level in LEVELS]
        inside = f"{result['worst']['inside']} of {ARMS}" if "worst" in result else "-"
        rows.append([label(name), *errors, inside])
    head = ["controller", *[f"error [rad] at {level:g} N m" for level in LEVELS], "random arms inside"]
    write_table("../README.md", "fronts", table(head, rows))


@styled
def draw_rival_fronts(results: dict[str, Any]) -> Figure:
    """Error over torque noise of each law, of all seeds together: the best five, and all others narrow."""
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    axes = figure.subplots()
    best = list(results)[: len(LINES)]
    for name in sorted(results, key=lambda name: name in best):
        aims = np.concatenate([np.reshape(front, (-1, 2)) for front in results[name]["fronts"]])
        aims = aims[non_dominated(aims)] if len(aims) else aims
        aims = aims[np.argsort(aims[:, 1])]
        look = LINES[best.index(name)] if name in best else NARROW
        axes.plot(aims[:, 1], aims[:, 0], **look, label=label(name).replace("`", "") if name in best else None)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(0.003, 0.5)
    axes.set_ylim(2e-5, 1e-2)
    plain_numbers(axes, [0.003, 0.01, 0.03, 0.1, 0.3])
    axes.set_xlabel("torque noise  [N m]")
    axes.set_ylabel("steady error  [rad]")
    axes.legend(loc="upper right")
    return figure
