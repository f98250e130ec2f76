"""The paper's figures, in its order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from slidax.analysis import index_sums
from slidax.core.errors import as_array
from slidax.law.envelopes import AbstractPerformance, Exponential, FiniteTime, FixedTime
from slidax.report import figures
from slidax.report.page import Picture, picture
from slidax.report.pages import tip_paths
from slidax.simulation.run import Run

from .examples import PROPOSED, READINGS, Case, Runs
from .printed import TABLE_3

Drawn = list[tuple[str, str, Figure, str]]
BARS = (
    ("fig-12", "Fig. 12", index_sums.iae),
    ("fig-13", "Fig. 13", index_sums.eci),
    ("fig-14", "Fig. 14", index_sums.aice),
)


def draw_two_links(runs: Runs) -> Drawn:
    """Draw Figs. 3 to 5, Example 4.1; return the name, title, figure and caption of each."""
    reading = runs.readings[0]
    how = READINGS[reading]
    listed, layered = runs.compared("4.1", reading), runs.compared("4.1", reading, ("ftsmc",))
    start = f"Example 4.1, {how}:"
    return [
        (
            "fig-3-all",
            "Fig. 3",
            figures.compared_errors(_runs(runs, listed | layered)),
            f"{start} errors of all schemes at the beginning, and their magnitudes. FTSMC with the sign, as "
            "Table 1 lists it, and with a boundary layer.",
        ),
        (
            "fig-4-all",
            "Fig. 4",
            figures.compared_torques(_runs(runs, layered)),
            f"{start} torques, FTSMC with a boundary layer of 0.05, which Table 1 does not list.",
        ),
        (
            "fig-4-sign",
            "Fig. 4, as Table 1 lists FTSMC",
            figures.compared_torques(_runs(runs, listed)),
            f"{start} torques, FTSMC with the sign. Bands: the range of a chattering torque.",
        ),
        (
            "fig-5-all",
            "Fig. 5",
            _tips(runs, listed),
            f"{start} path of the tip; the ring marks the start.",
        ),
    ]


def draw_three_joints(runs: Runs) -> Drawn:
    """Draw Figs. 8 to 14, Example 4.2; return the name, title, figure and caption of each."""
    reading = runs.readings[0]
    how = READINGS[reading]
    listed = runs.compared("4.2", reading)
    layered = runs.compared("4.2", reading, ("nftsmc",))
    every = listed | layered
    start = f"Example 4.2, {how}:"
    drawn = [
        (
            "fig-8",
            "Fig. 8",
            figures.compared_errors(_runs(runs, listed)),
            f"{start} errors of the four schemes of Table 2 at the beginning, and their magnitudes.",
        ),
        (
            "fig-9",
            "Fig. 9",
            figures.compared_velocity_errors(_runs(runs, listed)),
            f"{start} velocity errors at the beginning, and their magnitudes.",
        ),
        (
            "fig-10",
            "Fig. 10",
            figures.compared_torques(_runs(runs, layered)),
            f"{start} torques, NFTSMC with a boundary layer, which Table 2 does not list. Bands: the range of a "
            "chattering torque.",
        ),
        (
            "fig-10-sign",
            "Fig. 10, as Table 2 lists NFTSMC",
            figures.compared_torques(_runs(runs, listed)),
            f"{start} torques, NFTSMC with the sign. Bands: the range of a chattering torque, which exceeds the axes.",
        ),
        ("fig-11", "Fig. 11", _tips(runs, listed), f"{start} path of the tip; the rings mark the start."),
    ]
    for name, title, index in BARS:
        values = {called: index(runs[case]).tolist() for called, case in every.items()}
        first = runs[next(iter(every.values()))]
        label = f"{index.title}  [{' or '.join(dict.fromkeys(index.units(first)))}]"
        figure = figures.metric_bars(values, label, first.joint_names)
        drawn.append((name, title, figure, f"{start} {index.meaning}; no values are printed."))
    return drawn


def _runs(runs: Runs, cases: dict[str, Case]) -> dict[str, Run]:
    return {name: runs[case] for name, case in cases.items()}


def _tips(runs: Runs, cases: dict[str, Case]) -> Figure:
    paths = {name: tip_paths(runs.scenarios[case].plant.robot, runs[case]) for name, case in cases.items()}
    desired = max((path[1] for path in paths.values()), key=len)
    return figures.compared_tip_paths({name: path[0] for name, path in paths.items()}, desired)


FINAL = as_array(0.01)
"""Final radius of the functions of Fig. 1."""

IN_ENVELOPES = "in their envelopes, and their magnitudes. Dashed: the envelope's narrower side"


def draw(runs: Runs, folder: Path) -> dict[str, Picture]:
    """Write all figures of the report as SVG files, and return them by name, with titles and captions.

    - `folder`: folder for the files.
    """
    reading = runs.readings[0]
    how = READINGS[reading]
    two, three = Case("4.1", reading), Case("4.2", reading)
    drawn = [
        ("fig-1", "Fig. 1", _narrowing(), "The performance function (20) from two initial radii, with two deadlines."),
        (
            "families",
            "Next to Fig. 1",
            _families(),
            "Fixed-time functions settle at T = 5 s from any initial radius, finite-time functions later from a larger "
            "one, and exponential functions only in the limit.",
        ),
        (
            "fig-3",
            "Fig. 3, CFTSMPPC",
            figures.tracking_error(runs[two]),
            f"Example 4.1, tracking errors, {how}: {IN_ENVELOPES}.",
        ),
        *draw_two_links(runs),
        (
            "fig-7a",
            "Fig. 7(a)",
            figures.tracking_error(runs[three]),
            f"Example 4.2, tracking errors, {how}: {IN_ENVELOPES}.",
        ),
        ("fig-7b", "Fig. 7(b)", _sizes(runs), _sizes_caption(runs)),
        *draw_three_joints(runs),
    ]
    left = [case for case in runs.sampled if case.mode == "held" and not runs[case].outcome.ok]
    if left:
        drawn.append(_leaving(runs, left[-1]))
    return {name: picture(figure, folder, name, title, caption) for name, title, figure, caption in drawn}


def _fixed_time(initial: float, deadline: float) -> FixedTime:
    return FixedTime(as_array(initial), FINAL, as_array(deadline), as_array(2.01))


def _finite_time(initial: float) -> FiniteTime:
    """Return a finite-time performance function; from the initial radius 0.5 it also settles after 5 s."""
    return FiniteTime(as_array(initial), FINAL, as_array(0.49**0.2), as_array(0.8))


def _narrowing() -> Figure:
    functions = {
        rf"$\rho_0 = {initial:g}$, $T = {deadline:g}$ s": _fixed_time(initial, deadline)
        for initial in (0.5, 100.0)
        for deadline in (2.0, 5.0)
    }
    return figures.performance(functions, np.linspace(0.0, 6.0, 601))


def _families() -> Figure:
    functions: dict[str, AbstractPerformance] = {
        r"fixed-time, $\rho_0 = 0.5$": _fixed_time(0.5, 5.0),
        r"fixed-time, $\rho_0 = 100$": _fixed_time(100.0, 5.0),
        r"finite-time, $\rho_0 = 0.5$": _finite_time(0.5),
        r"finite-time, $\rho_0 = 100$": _finite_time(100.0),
        r"exponential, $\rho_0 = 100$": Exponential(as_array(100.0), FINAL, as_array(1.0)),
    }
    return figures.performance(functions, np.linspace(0.0, 16.0, 801))


def _leaving(runs: Runs, case: Case) -> tuple[str, str, Figure, str]:
    run = runs[case]
    end = float(run.outcome.t or 0.0)
    figure = figures.tracking_error(run, window=(end - 0.06, end))
    caption = (
        f"Example {case.example}, {READINGS[case.reading]}, torque held over {1e3 * case.period:g} ms: "
        f"the last 60 ms before joint {run.outcome.joint} leaves its envelope."
    )
    return "leaving", "Beyond the sampling limit", figure, caption


def _sizes(runs: Runs) -> Figure:
    shown = {READINGS[reading]: runs[Case("4.2", reading)] for reading in runs.readings}
    if "off" in runs.readings:
        shown["off, half the step"] = runs[Case("4.2", "off").halved]
    printed = next(item for item in TABLE_3[PROPOSED] if item.quantity == "steady_error")
    return figures.error_sizes(shown, levels={"printed in Table 3": printed.values})


def _sizes_caption(runs: Runs) -> str:
    half = ", and with it off at half the step" if "off" in runs.readings else ""
    hows = " and ".join(READINGS[reading] for reading in runs.readings)
    return f"Example 4.2, magnitudes of the tracking errors, {hows}{half}, with the steady-state errors of Table 3."
