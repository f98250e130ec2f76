"""Worst cases of the built-in scenarios, over what their pages say."""

from __future__ import annotations

from typing import Any

import numpy as np
from sampled_data_figures.loops import table, write_table

from slidax.studies import How, study_of

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
        "also masses and inertias, 20 % either way from those the law is told",
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
        "payload .1 to 2 kg, mass ±15 %, Coulomb and viscous friction of each joint up to the scenario's",
        {**PAYLOAD, "robot.plant.mass_factor": {"between": [0.85, 1.15]}, **FRICTION},
        500,
    ),
    (
        "panda-pick",
        "payload .1 to 2 kg, mass ±5 %, friction likewise",
        {**PAYLOAD, "robot.plant.mass_factor": {"between": [0.95, 1.05]}, **FRICTION},
        160,
    ),
    (
        "panda-drop",
        "payload .1 to 2 kg, mass ±15 %, friction likewise",
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
        "payload .1 to 3 kg, mass ±15 %, friction likewise",
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


def make() -> None:
    """What a search finds in each; the table of docs/searches.md."""
    rows = []
    for name, words, sets, runs in BUILT_IN:
        found = study_of({"study": "falsify", "scenario": name, "uncertainty": sets, "runs": runs}).run(How())
        rows.append(
            [f"`{name}`", words, f"{found.runs}", f"{found.failures}", f"{float(np.nanmin(found.table['margin'])):.3f}"]
        )
        print(rows[-1], flush=True)
    head = ["scenario", "what is uncertain", "runs", "fail", "least margin"]
    write_table("searches.md", "built-in", table(head, rows))
