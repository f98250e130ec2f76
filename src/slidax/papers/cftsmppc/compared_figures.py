"""The paper's figures that show several schemes."""

from __future__ import annotations

from matplotlib.figure import Figure

from slidax import figures
from slidax.reports import tip_paths
from slidax.simulation import Run

from .. import indices
from .runs import READINGS, Case, Runs

Drawn = list[tuple[str, str, Figure, str]]
BARS = (
    ("fig-12", "Fig. 12", indices.iae),
    ("fig-13", "Fig. 13", indices.eci),
    ("fig-14", "Fig. 14", indices.aice),
)


def of_two_links(runs: Runs) -> Drawn:
    """Figs. 3 to 5, Example 4.1.

    - `runs`: all runs.
    """
    reading = runs.readings[0]
    how = READINGS[reading]
    listed, layered = runs.compared("4.1", reading), runs.compared("4.1", reading, ("ftsmc",))
    start = f"Example 4.1, {how}:"
    return [
        (
            "fig-3-all",
            "Fig. 3",
            figures.compared_errors(_runs(runs, listed | layered)),
            f"{start} errors of all schemes at the beginning, and their sizes. FTSMC with the sign, as "
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
            f"{start} torques, FTSMC with the sign. Bands: the range of a torque that chatters.",
        ),
        (
            "fig-5-all",
            "Fig. 5",
            _tips(runs, listed),
            f"{start} path of the tip; the ring marks the start.",
        ),
    ]


def of_three_joints(runs: Runs) -> Drawn:
    """Figs. 8 to 14, Example 4.2.

    - `runs`: all runs.
    """
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
            f"{start} errors of the four schemes as listed at the beginning, and their sizes.",
        ),
        (
            "fig-9",
            "Fig. 9",
            figures.compared_velocity_errors(_runs(runs, listed)),
            f"{start} velocity errors at the beginning, and their sizes.",
        ),
        (
            "fig-10",
            "Fig. 10",
            figures.compared_torques(_runs(runs, layered)),
            f"{start} torques, NFTSMC with a boundary layer, which Table 2 does not list. Bands: the range of a torque "
            "that chatters.",
        ),
        (
            "fig-10-sign",
            "Fig. 10, as Table 2 lists NFTSMC",
            figures.compared_torques(_runs(runs, listed)),
            f"{start} torques, NFTSMC with the sign. Bands: the range of a torque that chatters; it leaves the axes.",
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
