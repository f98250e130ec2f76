"""A run that `slidax run --out` or `slidax loop --out` has written."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from slidax._errors import DefinitionError, DefinitionWarning
from slidax.logs import SavedLog, read_mcap
from slidax.scenarios import Scenario, brought_back, load
from slidax.simulation import read_columns

SCENARIO, LOG = "scenario.yaml", "log.parquet"
"""The files of a saved run."""


def read_saved(saved: Path) -> tuple[Scenario, dict[str, np.ndarray], bool]:
    """The scenario of a saved run, its log as flat columns, and whether each sample is in it.

    - `saved`: a folder that `slidax run --out` has written, or an MCAP file.

    Raises DefinitionError if a file is missing or is none of ours, or the package that reads it is not installed.
    """
    if saved.suffix == ".mcap":
        log = read_mcap(saved)
        if not log.whole:
            warnings.warn(
                f"`{saved}` has no end or is damaged: it is read as far as it is whole", DefinitionWarning, stacklevel=2
            )
        return brought_back(log.scenario, log.files, log.name), _columns(log), True
    for name in (SCENARIO, LOG):
        if not (saved / name).is_file():
            raise DefinitionError(
                f"`{saved}` has no `{name}`: give an MCAP file, or the folder of a run that `slidax run SCENARIO --out "
                "FOLDER` has written"
            )
    columns = read_columns(saved / LOG)
    scenario = load(saved / SCENARIO)
    return scenario, columns, scenario.log_every == 1


def _columns(log: SavedLog) -> dict[str, np.ndarray]:
    """A row for each tick of the arm; where the law gave no answer, its last one stood."""
    arm, law = log.arm, log.law
    if not len(arm["true_k"]) or not len(law["k"]):
        raise DefinitionError(f"`{log.path}` has no ticks of a simulated arm on `/truth`")
    answer = np.maximum(np.searchsorted(law["k"], arm["true_k"], side="right") - 1, 0)
    wide: dict[str, np.ndarray] = {
        "q": arm["true_q"],
        "dq": arm["true_dq"],
        "e": arm["true_e"],
        "tau": arm["set_tau"],
        # Of the reference itself the law's last word may be old.
        "q_d": arm["true_q"] - arm["true_e"],
        **{name: law[name][answer] for name in ("dq_d", "ddq_d", "lower", "upper") if name in law},
    }
    wide |= {name: law[f"signal:{name}"][answer] for name in log.channels.signals}
    table = {"k": arm["true_k"], "t": arm["true_t"]}
    for name, values in wide.items():
        if values.ndim == 1:
            table[name] = values
            continue
        table |= {f"{name}_{joint + 1}": column for joint, column in enumerate(values.T)}
    return table
