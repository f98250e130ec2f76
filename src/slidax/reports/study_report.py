"""The page of a study."""

from __future__ import annotations

import json
from pathlib import Path

from slidax._writing import write_text
from slidax.scenarios.written import as_yaml
from slidax.studies import AbstractResult, AbstractStudy

from .machine import machine, versions
from .page import render
from .parameters import write_scenario
from .picture import picture


def write_study_report(
    study: AbstractStudy, found: AbstractResult, out: Path, *, seconds: float, command: str = ""
) -> Path:
    """Writes `out/report.html`, `out/figures/*.svg`, `out/results.json` and the scenarios, and returns the page's path.

    - `study`: what was asked.
    - `found`: the answer.
    - `out`: a folder, made if missing.
    - `seconds`: that it took.
    - `command`: the command that did it, for the page.
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = found.scenarios()
    for name, description in kept.items():
        write_scenario(description, out / f"{name}.yaml")
    sections = [
        (one, [picture(drawn.figure, out / "figures", drawn.name, drawn.title, drawn.caption) for drawn in one.figures])
        for one in found.sections()
    ]
    values = {
        "title": study.title or f"{study.scenario}: {study.study.replace('_', ' ')}",
        "kind": study.study.replace("_", " "),
        "found": found,
        "sections": sections,
        "scenarios": {name: as_yaml(description) for name, description in kept.items()},
        "parameters": as_yaml(study),
        "versions": versions(),
        "machine": machine(),
        "seconds": seconds,
        "command": command,
    }
    write_text(out / "results.json", json.dumps(found.as_json(), indent=2, allow_nan=False, ensure_ascii=False))
    page = out / "report.html"
    write_text(page, render("study.html.j2", values))
    return page
