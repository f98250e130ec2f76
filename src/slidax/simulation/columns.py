"""A run's log as flat columns with names and units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slidax._errors import DefinitionError

if TYPE_CHECKING:
    from .run import Run

PER = {"q": "", "dq": "/s", "q_d": "", "dq_d": "/s", "ddq_d": "/s²", "e": "", "lower": "", "upper": ""}
"""Suffixes to the unit of a joint's position."""


def columns_of(run: Run, labels: Sequence[str]) -> dict[str, tuple[np.ndarray, str]]:
    """Columns of a single run's log by name, each with its unit: sample, time, state, reference, error, torque, ...

    - `labels`: suffix of a quantity's name for each joint.

    Raises DefinitionError for a run without a log, and for many runs.
    """
    log = run.log
    if log is None:
        raise DefinitionError("this run has no log: simulate with `log_every=1`")
    if run.period.ndim:
        raise DefinitionError(f"these are {len(run)} runs: take the log of each, as `runs[0]`")
    groups: dict[str, Any] = {
        "q": log.state.q,
        "dq": log.state.dq,
        "q_d": log.reference.q,
        "dq_d": log.reference.dq,
        "ddq_d": log.reference.ddq,
        "e": log.e,
        "tau": log.tau,
    }
    if log.envelope is not None:
        groups |= {"lower": log.envelope.lower, "upper": log.envelope.upper}
    groups |= log.signals
    columns = {"k": (np.asarray(log.k), ""), "t": (np.asarray(log.t), "s")}
    for name, array in groups.items():
        values = np.asarray(array)
        if values.ndim == 1:
            columns[name] = values, ""
            continue
        flat = values.reshape(len(values), -1)
        wide = labels if flat.shape[1] == len(labels) else [f"_{k + 1}" for k in range(flat.shape[1])]
        for k, label in enumerate(wide):
            columns[f"{name}{label}"] = flat[:, k], _unit(name, run, k)
    return columns


def _unit(name: str, run: Run, joint: int) -> str:
    if name == "tau":
        return run.torque_units[joint]
    return run.joint_units[joint] + PER[name] if name in PER else ""
