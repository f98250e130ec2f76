"""Tables of docs/certificates: soundness, the paper's examples, and the monitor."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as parquet
from typer.testing import CliRunner

from slidax import analysis
from slidax.certify.arm import uncertainty_bound
from slidax.certify.printed import printed_period, settling_time, ultimate_bound
from slidax.certify.printed.printed_law import PrintedLaw
from slidax.cli import app
from slidax.codegen.llvm import machine
from slidax.paper.numbers import inverse_inertia
from slidax.scenarios import Scenario, load
from tests.soundness import continuous, postures, ratios, starts, warned
from tests.soundness.counted import Counted

from .shared import ROOT, table, write_table

EXAMPLES = ("example-4.1", "example-4.2")
PAPER_PAGE = "tutorials/reproduce-the-paper.md"
GROWTH = 20.0
"""A loop chatters if its steady torque steps are larger than those at half the period by this factor."""

FINENESS = 0.002
"""Of the period that is searched, relative to it."""


def _settled(scenario: Scenario) -> float:
    """When the last joint was last out of its core."""
    law, run = PrintedLaw.of(scenario), scenario.simulate(log_every=1)
    assert law is not None
    assert law.powers is not None
    assert run.log is not None
    t, e = np.asarray(run.log.t), np.asarray(run.log.e)
    sides, radius = law.psi(np.stack([law.powers.delta, -law.powers.delta])), law.radius(t)
    outside = ((e > sides[0] * radius) | (e < sides[1] * radius)).any(axis=1)
    return float(t[outside].max())


def _times(name: str) -> list[str]:
    scenario = load(name)
    bound = settling_time(scenario).bound
    reaching = bound["reaching"]
    cells = [reaching["printed"], np.max(bound["printed"]), reaching["supremum"], np.max(bound["supremum"])]
    cells += [np.max(bound["given_start"]), np.max(bound["deadline"]), _settled(scenario)]
    return [f"`{name}`", *(f"{cell:.3g}" for cell in cells)]


def _inertia(name: str) -> list[str]:
    bounds = inverse_inertia(load(name))
    return [
        f"`{name}`",
        f"{bounds['m1']:g}, {bounds['m2']:g}",
        *(" to ".join(f"{value:.3g}" for value in bounds[norm]) for norm in ("eigenvalues", "spectral", "frobenius")),
        f"{bounds['mismatch']:.3g}",
        f"{bounds['gamma']:.3g}",
    ]


def _step(name: str, period: float) -> float:
    """The largest torque step over the last quarter; infinite for a run that ends badly."""
    run = load(name, {"simulation.mode": "held", "simulation.period": period}).simulate(log_every=None)
    return float(np.max(analysis.steady_torque_step(run))) if run.outcome.ok else np.inf


def _whole(name: str, period: float) -> float:
    """The nearest period of which a run has a whole number."""
    t1 = load(name).t1
    return t1 / round(t1 / period)


def _period(name: str) -> list[str]:
    bound = printed_period(load(name)).bound
    limit = bound["limit"]
    calm = _step(name, _whole(name, 0.5 * limit))
    low, high = 0.7 * limit, 1.4 * limit
    while high / low > 1.0 + FINENESS:
        middle = np.sqrt(low * high)
        chatters = _step(name, _whole(name, middle)) > GROWTH * calm
        low, high = (low, middle) if chatters else (middle, high)
    return [
        f"`{name}`",
        *(f"{1e3 * value:.3g}" for value in (bound["surface"], bound["layer"], limit, bound["period"], high)),
    ]


def _error(scale: float) -> list[str]:
    scenario = load("example-4.2", {"disturbance.scale": scale})
    verdict = ultimate_bound(scenario)
    run = scenario.simulate(log_every=None)
    observed = float(np.max(analysis.steady_error(run)))
    bound = float(np.max(verdict.bound["error"])) if verdict.holds else np.nan
    cells = (bound, float(np.max(verdict.bound["estimate"])), observed)
    return [f"{scale:g}", *("-" if np.isnan(cell) else f"{cell:.2g}" for cell in cells)]


def _bound(name: str) -> list[str]:
    bound = uncertainty_bound(load(name)).bound
    return [f"`{name}`", *(f"{float(bound[key]):.3g}" for key in ("gamma", "b0", "b1", "b2"))]


def write_paper() -> None:
    """Measure, and write the tables."""
    head = ["example", "T_r printed", "T_max printed", "T_r unsplit", "unsplit", "this start", "T_i", "observed"]
    write_table(PAPER_PAGE, "times", table(head, [_times(name) for name in EXAMPLES]))
    head = ["example", "m1, m2", "eigenvalues of M⁻¹", "spectral", "Frobenius", "max of M⁻¹M0 - I", "γ"]
    write_table(PAPER_PAGE, "inertia", table(head, [_inertia(name) for name in EXAMPLES]))
    head = ["example", "surface [ms]", "layer [ms]", "both [ms]", "bound [ms]", "observed [ms]"]
    write_table(PAPER_PAGE, "period", table(head, [_period(name) for name in EXAMPLES]))
    head = ["disturbance", "bound", "estimated", "observed"]
    write_table(PAPER_PAGE, "error", table(head, [_error(scale) for scale in (0.5, 1.0, 2.0)]))
    head = ["example", "γ", "b0 [N m]", "b1 [N m/rad]", "b2 [N m s²/rad²]"]
    write_table(PAPER_PAGE, "uncertainty", table(head, [_bound(name) for name in EXAMPLES]))


JOINTS = range(1, 8)
SEED = 7


def some(number: float, share: float) -> int:
    """A share of a number, at least 1."""
    return max(round(number * share), 1)


def each(judge: Callable[..., None], cases: float, runs: int, **changes: Any) -> Callable[[Counted, float], None]:
    """Check random cases for each number of joints."""

    def check(count: Counted, share: float) -> None:
        for joints in JOINTS:
            judge(SEED, some(cases, share), runs, joints, count, **changes)

    return check


def check_parameters(count: Counted, share: float) -> None:
    """Check admissible parameters."""
    starts.judged_parameters(SEED, some(2000, share), count)


def check_admissibility(count: Counted, share: float) -> None:
    """Check admissible initial sets; arms take longer than other cases."""
    for joints in JOINTS:
        starts.judged(SEED, some(60 if joints in starts.ARMS else 300, share), 1000, joints, count)


def check_arm_constants(count: Counted, share: float) -> None:
    """Check bounds of the arm's matrices."""
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(some(26, share)):
            postures.judged(Path(folder), 100 + seed, count)


ALL = {
    "parameters": (check_parameters, "(20), (13), (29)-(47): a number out of its range"),
    "admissibility": (check_admissibility, "starts of random sets, over the envelope"),
    "inertia_ratio": (each(ratios.judged, 40, 400), "the largest modulus, of κ in the range"),
    "settling_time": (
        each(continuous.judged_settling, 60, 250),
        "when abs(ε1) <= δ for good, over `given_start` or `supremum`",
    ),
    "ultimate_bound": (each(continuous.judged_ultimate, 60, 250), "abs(e) once s and e were as small as is assumed"),
    "arm constants": (check_arm_constants, "M, G, C and their slopes in random postures of random chains"),
    "monitor": (each(warned.judged, 10, 400), "runs that leave, warned of before; q and q̇ are measured"),
    "monitor, filter": (each(warned.judged, 2, 200, kalman=True), "the same with a filter slower than the horizon"),
}

UNPROMISED = ("monitor, filter",)
"""Checks whose bound is no guarantee: docs/certificates/index.md."""


def measure_soundness() -> None:
    """Check in random cases of every certificate that no bound is exceeded: the table of docs/certificates/index.md.

    The exit code is 1 if a guarantee is violated.
    """
    # Compilers would take most of the time; bits are the same at any level.
    machine.OPTIMISED = 0
    parser = argparse.ArgumentParser(description=measure_soundness.__doc__)
    parser.add_argument("--share", type=float, default=1.0, help="of the cases")
    parser.add_argument("--only", nargs="*", choices=list(ALL), default=list(ALL))
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    lines = [
        "| of | what is compared | joints | cases | exceeded | nearest | cannot be promised, refused | taken |",
        "|---|---|---|---:|---:|---:|---:|---:|",
    ]
    broken: list[str] = []
    for name in options.only:
        judge, what = ALL[name]
        count, begun = Counted(), time.process_time()
        judge(count, options.share)
        lines.append(count.row(name, what))
        if name not in UNPROMISED and (count.exceeded or count.missed):
            broken.append(name)
        print(lines[-1], f"{time.process_time() - begun:.0f} s", flush=True)
        if count.again:
            print(f"  {count.again} laws were run again, finer", flush=True)
        for note in count.notes[:20]:
            print(f"  {note}", flush=True)
    text = "\n".join(lines)
    print(text)
    if options.write:
        write_table("certificates/index.md", "soundness", text)
    if broken:
        raise SystemExit(f"a bound is exceeded, or a promise does not hold: {', '.join(broken)}")


MONITOR = {"scheme.sampled_data.monitor": {"share": 0.5, "led": 0.8}}


def monitor_row(which: str, runs: int, seed: int | None) -> str:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        file = ROOT / "examples" / "studies" / f"monitor-{which}.yaml"
        seeded = [] if seed is None else ["--seed", str(seed)]
        answer = CliRunner().invoke(app, ["study", str(file), "--out", folder, "--runs", str(runs), *seeded])
        if answer.exit_code not in (0, 3, 4):
            raise SystemExit(answer.output)
        rows = parquet.read_table(Path(folder) / "rows.parquet")
    outcome, left_at, warned = (np.asarray(rows[name].to_numpy(), float) for name in ("outcome", "t", "warned_at"))
    left = outcome > 0
    lead = 1e3 * (left_at - warned)[left]
    early = f"{np.sum(lead > 0)} | {np.median(lead):.0f} | {np.min(lead):.0f}" if left.any() else "- | - | -"
    return f"| {which} | {runs} | {left.sum()} | {early} | {np.sum(~np.isnan(warned[~left]))} |"


def monitor_cost(repeats: int = 15) -> float:
    """The time of a run with a monitor over one without, the least of interleaved runs."""
    # Both as optimised code, also the one that is not cached.
    machine.QUICK = machine.OPTIMISED
    both = [load("panda-payload", changes) for changes in ({}, MONITOR)]
    for scenario in both:
        scenario.simulate(log_every=None)
    taken: list[list[float]] = [[], []]
    for _ in range(repeats):
        for times, scenario in zip(taken, both, strict=True):
            begun = time.perf_counter()
            scenario.simulate(log_every=None)
            times.append(time.perf_counter() - begun)
    return min(taken[1]) / min(taken[0])


def measure_monitor() -> None:
    """Measure the monitor inside, in the corners and outside of its set, and its cost: docs/certificates/index.md."""
    parser = argparse.ArgumentParser(description=measure_monitor.__doc__)
    sets = ("inside", "corners", "outside")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--only", nargs="*", choices=sets, default=sets)
    parser.add_argument("--seed", type=int, help="in place of the studies' own")
    options = parser.parse_args()
    print("| cases | runs | left | warned before | median [ms] | least [ms] | stayed, and was warned |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    for which in options.only:
        print(monitor_row(which, options.runs, options.seed), flush=True)
    if options.only == sets:
        print(f"\nA run with the monitor takes {monitor_cost():.3f} times one without.")
