"""The reproduction: run all examples, compare, and write the report."""

from __future__ import annotations

import json
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from slidax import analysis
from slidax.analysis import index_sums
from slidax.core.errors import DefinitionError
from slidax.core.errors import short_repr as in_short
from slidax.core.files import json_value
from slidax.core.writing import write_text
from slidax.report.page import machine, render, versions
from slidax.scenarios.yaml_text import as_yaml

from .claims import CONTINUOUS, Claim, claims, findings, parameter_claims
from .examples import EXAMPLES, PROPOSED, READINGS, SCHEMES, Case, Progress, Reading, Runs, simulate_all
from .figures import draw
from .numbers import Row, numbers
from .printed import CLOSE, DOI, JOURNAL, KINDS, NOT_COVERED, REPRODUCED, TITLE, PrintedComparison


def counts(rows: list[Row], claims: list[Claim]) -> dict[str, dict[str, int]]:
    """Return the number of verdicts of each kind, by reading of the disturbance.

    - `rows`, `claims`: results with a verdict for each reading.
    """
    result: dict[str, list[PrintedComparison]] = {}
    for verdicts in [item.verdicts for item in rows] + [item.verdicts for item in claims]:
        for reading, verdict in verdicts.items():
            result.setdefault(reading, []).append(verdict)
    tallies = {reading: Counter(verdict.kind for verdict in verdicts) for reading, verdicts in result.items()}
    return {reading: {kind: tally[kind] for kind in KINDS} for reading, tally in tallies.items()}


def select_sentences(runs: Runs, rows: list[Row], claims: list[Claim]) -> dict[str, Any]:
    """Return the values that select sentences of the report, by name.

    Three are True if the verdicts support a sentence: `settling` (settling times are reproduced without disturbance),
    `without_disturbance` (the error limit is reproduced only without disturbance) and `smooth` (the torque is
    continuous). `runs` is the number of CFTSMPPC's runs with the paper's step and layer, and `inside` the number of
    those that stay in their envelopes.

    - `rows`, `claims`: results with their verdicts.
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
    """Return an item for every run: the fields of its `Case`, its outcome, metrics and computing times."""
    return [_run_result(case, runs) for case in runs.runs]


def _run_result(case: Case, runs: Runs) -> dict[str, Any]:
    run = runs[case]
    timing = run.timing
    return {
        **case._asdict(),
        "t1": float(run.t1),
        "outcome": run.outcome.kind,
        "message": run.outcome.message,
        "metrics": analysis.summary(run, index_sums.INDEX_SUMS),
        "compile_s": None if timing is None else timing.compile_s,
        "run_s": None if timing is None else timing.run_s,
    }


CHOICES: dict[str, tuple[Reading, ...]] = {"stated": ("stated",), "off": ("off",), "both": ("stated", "off")}
SIMULATING = 0.75
"""Share of the whole progress for the simulation."""


def reproduce(
    out: str | Path,
    disturbance: str = "both",
    progress: Progress | None = None,
    *,
    changes: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Run the paper's two examples, and write `out/report.html`, `out/figures/*.svg` and `out/results.json`.

    - `out`: a folder, created if missing.
    - `disturbance`: "stated", "off", or "both".
    - `progress`: called with the current step and the completed fraction, 0 to 1.
    - `changes`: new values for all scenarios by dotted path, such as `{"simulation.t1": 1.0}` for a short trial.

    Returns the content of `results.json`.

    Raises DefinitionError if the disturbance has another value.
    """
    if disturbance not in CHOICES:
        known = ", ".join(f'"{choice}"' for choice in CHOICES)
        raise DefinitionError(f"`disturbance` must be one of {known}; got {in_short(disturbance)}")
    tell = progress or (lambda stage, fraction: None)
    started = time.perf_counter()
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)

    runs = simulate_all(CHOICES[disturbance], changes or {}, lambda stage, done: tell(stage, SIMULATING * done))
    tell("Comparing with the paper", SIMULATING)
    rows, statements, promises, result = numbers(runs), claims(runs), parameter_claims(runs), findings(runs)
    tell("Drawing the figures", SIMULATING + 0.03)
    pictures = draw(runs, out / "figures")
    tell("Writing the report", 0.97)
    results = {
        "paper": {"title": TITLE, "journal": JOURNAL, "doi": DOI},
        "made": {
            "command": f"slidax reproduce --out {out} --disturbance {disturbance}",
            "date": datetime.now(UTC).date().isoformat(),
            "seconds": time.perf_counter() - started,
            "versions": versions(),
            "machine": machine(),
        },
        "readings": {reading: READINGS[reading] for reading in runs.readings},
        "rule": {"reproduced_within": REPRODUCED, "close_within": CLOSE, "settling_band": SCHEMES[PROPOSED].band},
        "counts": counts(rows, statements),
        "numbers": rows,
        "claims": statements,
        "promises": promises,
        "findings": result,
        "runs": run_results(runs),
        "figures": [f"figures/{name}.svg" for name in pictures],
        "not_covered": list(NOT_COVERED),
    }
    data: dict[str, Any] = json_value(results)
    write_text(out / "results.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    scenarios = {example: runs.scenarios[Case(example, runs.readings[0])] for example in EXAMPLES}
    page = {
        **data,
        "pictures": pictures,
        "shown": select_sentences(runs, rows, statements),
        "scenarios": scenarios,
        "parameters": {example: as_yaml(scenario.description) for example, scenario in scenarios.items()},
    }
    write_text(out / "report.html", render("cftsmppc.html.j2", page, ("slidax.paper",)))
    tell("Done", 1.0)
    return data
