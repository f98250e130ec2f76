"""Worst cases of scenarios that were made to fail in a corner, beside random ones."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from sampled_data_figures.loops import table, write_table

from slidax.studies import How, read_study, study_of
from slidax.studies.falsify import Falsify, FalsifyResult

from .maps import STUDIES

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


HEAD = [
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


def make() -> None:
    """Random cases, the search, and the search where the flaw is mended; the table of docs/searches.md."""
    rows = []
    for one in SEEDED:
        rows.append(row(one))
        print(rows[-1], flush=True)
    write_table("searches.md", "seeded", table(HEAD, rows))


def row(one: Seeded) -> list[str]:
    """One scenario's line of the table.

    - `one`: the scenario.
    """
    study = read_study(STUDIES / f"falsify-{one.name}.yaml")
    assert isinstance(study, Falsify)
    said = study.model_dump(include={"scenario", "changes", "uncertainty"}, exclude_unset=True)
    random = study_of({**said, "study": "monte_carlo", "runs": RANDOM}).run(How())
    begun = time.perf_counter()
    found = study.run(How())
    took = time.perf_counter() - begun
    mended = study.model_copy(update={"changes": {**study.changes, **one.mended}}).run(How())
    failed = found.table["outcome"] > 0
    return [
        one.flaw,
        f"{np.sum(random.table['outcome'] > 0)}",
        f"{np.min(random.table['margin']):.3f}",
        f"{found.failures} of {found.runs}",
        f"{np.argmax(failed) + 1 if found.failures else '-'}",
        f"{_least(found):.3f}",
        f"{took:.0f}",
        f"{mended.failures} of {mended.runs}",
        f"{_least(mended):.3f}",
    ]


def _least(found: FalsifyResult) -> float:
    return float(np.nanmin(found.table["margin"]))
