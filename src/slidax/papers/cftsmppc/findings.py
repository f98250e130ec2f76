"""The numbers behind the sentences of the report."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax import metrics
from slidax.simulation import Run

from .. import indices
from .bounds import expected_error, inverse_inertia, settling_bound
from .measured import steady_error, table_3
from .printed import STEADY_LIMIT, TABLE_3
from .rivals import bands, compared, energy, jumps, layers, printed_alpha, sensitivity, settling_bounds
from .runs import EXAMPLES, READINGS, Case, Runs
from .schemes import PROPOSED, SCHEMES

BAND = SCHEMES[PROPOSED].band


def findings(runs: Runs) -> dict[str, Any]:
    """Every number that a sentence of the report names, ready for JSON.

    - `runs`: all runs.
    """
    accuracy = {
        reading: steady_error(runs[Case("4.2", reading)]) if reading in runs.readings else None for reading in READINGS
    }
    printed = {item.quantity: list(item.values) for item in TABLE_3[PROPOSED]}
    first = runs.readings[0]
    return {
        "printed": printed | {"steady_limit": float(STEADY_LIMIT)},
        "accuracy": accuracy,
        "expected": _expected(runs),
        "truncation": _truncation(runs),
        "settling": {
            reading: metrics.summary(runs[Case("4.2", reading)])["settling_time"] for reading in runs.readings
        },
        "peaks": {reading: table_3(runs[Case("4.2", reading)], "peak_torque", BAND) for reading in runs.readings},
        "sampling": [_sampled(runs, case) for case in runs.sampled],
        "inertia": {example: inverse_inertia(runs.scenarios[Case(example, first)]) for example in EXAMPLES},
        "bounds": {example: settling_bound(runs.scenarios[Case(example, first)]) for example in EXAMPLES},
        "compared": compared(runs),
        "bands": bands(runs),
        "sensitivity": sensitivity(runs),
        "settling_bounds": settling_bounds(runs),
        "jumps": jumps(runs),
        "alpha": printed_alpha(runs),
        "energy": energy(runs),
        "ftsmc": layers(runs, "ftsmc"),
        "nftsmc_layer": SCHEMES["nftsmc"].other,
        "rows": {
            reading: {case.name: steady_error(runs[case]) for case in runs.compared("4.2", reading).values()}
            for reading in runs.readings
        },
        "last_above_1e-3": max(
            float(metrics.settling_time(runs[Case(example, first)], 1e-3).max()) for example in EXAMPLES
        ),
    }


def _expected(runs: Runs) -> list[float] | None:
    if "stated" not in runs.readings:
        return None
    case = Case("4.2", "stated")
    return expected_error(runs.scenarios[case], runs[case])


def _truncation(runs: Runs) -> dict[str, list[float]] | None:
    """The steady error without disturbance at the step and at half of it, and how many times it falls."""
    if "off" not in runs.readings:
        return None
    case = Case("4.2", "off")
    whole, half = steady_error(runs[case]), steady_error(runs[case.halved])
    if whole is None or half is None:
        return None
    return {"step": whole, "half": half, "factor": (np.asarray(whole) / np.asarray(half)).tolist()}


def _sampled(runs: Runs, case: Case) -> dict[str, Any]:
    """Comparison of a run at a longer period, or with a held torque, with the example itself."""
    run = runs[case]
    reference = runs[Case(case.example, case.reading)]
    return {
        "example": case.example,
        "mode": case.mode,
        "period": case.period,
        "outcome": run.outcome.kind,
        "message": run.outcome.message,
        "t": run.outcome.t,
        "aice": indices.aice(run).tolist(),
        "aice_ratio": _ratio(run, reference),
    }


def _ratio(run: Run, reference: Run) -> list[float] | None:
    return (indices.aice(run) / indices.aice(reference)).tolist() if run.outcome.ok else None
