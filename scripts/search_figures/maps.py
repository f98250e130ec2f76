"""Maps of the margin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from sampled_data_figures.loops import save

from slidax.figures import parameter_map
from slidax.studies import How, read_study
from slidax.studies.sweep import Sweep, one_number

STUDIES = Path(__file__).parents[2] / "examples" / "studies"
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


def make() -> None:
    """Runs the sweeps of examples/studies, and draws them."""
    for name, (file, changes) in MAPS.items():
        study = read_study(STUDIES / f"{file}.yaml")
        assert isinstance(study, Sweep)
        found = study.model_copy(update={"changes": {**study.changes, **changes}}).run(How())
        axes = {LABELS[path]: one_number(axis) for path, axis in found.axes.items()}
        # A map without a bound in it shows nothing that the sentence does not say.
        if not found.good:
            save(parameter_map(axes, np.maximum(found.worst, -1.0), "least margin", 0.0), name)
        print(f"{name}: {found.lead}", flush=True)
