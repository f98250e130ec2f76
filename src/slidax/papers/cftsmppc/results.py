"""The results as plain data: what the tables of the report show, and with what they were made."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from typing import Any

from slidax import metrics

from .. import indices
from .comparison import CONTINUOUS, Claim
from .numbers import Row
from .runs import Case, Runs
from .schemes import PROPOSED, SCHEMES
from .verdicts import KINDS, Verdict


def counts(rows: list[Row], claims: list[Claim]) -> dict[str, dict[str, int]]:
    """Numbers of verdicts of each kind, by reading of the disturbance.

    - `rows`, `claims`: with a verdict for each reading.
    """
    result: dict[str, list[Verdict]] = {}
    for verdicts in [item.verdicts for item in rows] + [item.verdicts for item in claims]:
        for reading, verdict in verdicts.items():
            result.setdefault(reading, []).append(verdict)
    tallies = {reading: Counter(verdict.kind for verdict in verdicts) for reading, verdicts in result.items()}
    return {reading: {kind: tally[kind] for kind in KINDS} for reading, tally in tallies.items()}


def shown(runs: Runs, rows: list[Row], claims: list[Claim]) -> dict[str, Any]:
    """Which of the report's sentences the verdicts bear out.

    - `runs`: all runs.
    - `rows`, `claims`: with their verdicts.
    """
    proposed = [row for row in rows if row.scheme == SCHEMES[PROPOSED].name]
    settling = [
        row.verdicts["off"].kind for row in proposed if row.quantity == "settling_time" and "off" in row.verdicts
    ]
    limit = {
        reading: verdict.kind for row in rows if row.quantity == "limit" for reading, verdict in row.verdicts.items()
    }
    held = [run.outcome.ok for case, run in runs.runs.items() if case == Case(case.example, case.reading)]
    smooth = [verdict.kind for claim in claims if claim.says == CONTINUOUS for verdict in claim.verdicts.values()]
    return {
        "settling": bool(settling) and set(settling) == {"reproduced"},
        "without_disturbance": limit == {"stated": "differs", "off": "reproduced"},
        "inside": sum(held),
        "runs": len(held),
        "smooth": set(smooth) == {"reproduced"},
    }


def run_results(runs: Runs) -> list[dict[str, Any]]:
    """Every run with its outcome and metrics.

    - `runs`: all runs.
    """
    return [_run_result(case, runs) for case in runs.runs]


def plain(value: Any) -> Any:
    """The value as JSON has it: dataclasses become mappings, and what is not finite becomes null.

    - `value`: mappings, lists, dataclasses of this package, numbers and text.
    """
    if isinstance(value, Row | Claim | Verdict):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _run_result(case: Case, runs: Runs) -> dict[str, Any]:
    run = runs[case]
    timing = run.timing
    return {
        **case._asdict(),
        "t1": float(run.t1),
        "outcome": run.outcome.kind,
        "message": run.outcome.message,
        "metrics": metrics.summary(run, indices.INDICES),
        "compile_s": None if timing is None else timing.compile_s,
        "run_s": None if timing is None else timing.run_s,
    }
