"""One call that runs all examples and writes the report."""

from __future__ import annotations

import json
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from slidax._errors import DefinitionError
from slidax._errors import shown as in_short
from slidax._writing import write_text
from slidax.reports import machine, render, versions
from slidax.scenarios.written import as_yaml

from .comparison import claims, promises
from .figures import draw
from .findings import findings
from .numbers import numbers
from .printed import DOI, JOURNAL, NOT_COVERED, TITLE
from .results import counts, plain, run_results, shown
from .runs import EXAMPLES, READINGS, Case, Progress, Reading, simulate_all
from .schemes import PROPOSED, SCHEMES
from .verdicts import CLOSE, REPRODUCED

CHOICES: dict[str, tuple[Reading, ...]] = {"stated": ("stated",), "off": ("off",), "both": ("stated", "off")}
SIMULATING = 0.75
"""The share of the work that is simulation, for the progress."""


def reproduce(
    out: Path,
    disturbance: str = "both",
    progress: Progress | None = None,
    *,
    changes: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Runs the paper's two examples and writes `out/report.html`, `out/figures/*.svg` and `out/results.json`.

    - `out`: a folder, made if missing.
    - `disturbance`: "stated", "off", or "both" side by side.
    - `progress`: told what is being done and which fraction of all is done, 0 to 1.
    - `changes`: values by dotted path for all scenarios, such as `{"simulation.t1": 1.0}` for a short trial.

    Returns what is in `results.json`.

    Raises DefinitionError if the disturbance is none of the three.
    """
    if disturbance not in CHOICES:
        known = ", ".join(f'"{choice}"' for choice in CHOICES)
        raise DefinitionError(f"`disturbance` must be one of {known}; got {in_short(disturbance)}")
    tell = progress or (lambda stage, fraction: None)
    started = time.perf_counter()
    out.mkdir(parents=True, exist_ok=True)

    runs = simulate_all(CHOICES[disturbance], changes or {}, lambda stage, done: tell(stage, SIMULATING * done))
    tell("Comparing with the paper", SIMULATING)
    rows, text, promised, result = numbers(runs), claims(runs), promises(runs), findings(runs)
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
        "counts": counts(rows, text),
        "numbers": rows,
        "claims": text,
        "promises": promised,
        "findings": result,
        "runs": run_results(runs),
        "figures": [f"figures/{name}.svg" for name in pictures],
        "not_covered": list(NOT_COVERED),
    }
    data: dict[str, Any] = plain(results)
    write_text(out / "results.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    scenarios = {example: runs.scenarios[Case(example, runs.readings[0])] for example in EXAMPLES}
    page = {
        **data,
        "pictures": pictures,
        "shown": shown(runs, rows, text),
        "scenarios": scenarios,
        "parameters": {example: as_yaml(scenario.description) for example, scenario in scenarios.items()},
    }
    write_text(out / "report.html", render("cftsmppc.html.j2", page, ("slidax.papers.cftsmppc",)))
    tell("Done", 1.0)
    return data
