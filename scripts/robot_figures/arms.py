"""The built-in scenarios of arms from files, measured: exact or by encoders, on our plant or on MuJoCo's."""

from __future__ import annotations

import numpy as np
from sampled_data_figures.loops import small, steady_error, steady_step, table, write_table

from slidax import metrics, scenarios

from .panda import EXACT

DRY = {"simulation.plant": "mujoco", "simulation.friction": "dry"}
MUJOCO = {"simulation.plant": "mujoco"}

RUNS = [
    ("panda-payload", "encoders", "own", {}),
    ("panda-payload", "encoders", "MuJoCo", MUJOCO),
    ("panda-payload", "encoders", "MuJoCo, dry friction", DRY),
    ("panda-payload", "exact", "own", EXACT),
    ("panda-payload", "exact", "MuJoCo", {**EXACT, **MUJOCO}),
    ("panda-payload", "exact", "MuJoCo, dry friction", {**EXACT, **DRY}),
    ("ur5e-payload", "encoders", "own", {}),
    ("ur5e-payload", "encoders", "MuJoCo", MUJOCO),
    ("panda-pick", "encoders", "own", {}),
    ("panda-pick", "encoders", "MuJoCo", MUJOCO),
    ("panda-drop", "encoders", "MuJoCo", {}),
    ("panda-table", "encoders", "MuJoCo", {}),
]


def make() -> None:
    """Simulates all of them, and writes the table of docs/robots.md."""
    rows = []
    for name, measured, plant, changes in RUNS:
        run = scenarios.load(name, changes).simulate(log_every=None)
        margin = float(np.min(metrics.envelope_margin(run)))
        count = f"{int(run.tally.violations)}"
        rows.append(
            [name, measured, plant, count, f"{margin:.2f}", small(steady_error(run)), f"{steady_step(run):.2g}"]
        )
    head = ["scenario", "measurements", "plant", "samples outside", "margin", "steady error [rad]", "step [N m]"]
    write_table("robots.md", "arms", table(head, rows))
