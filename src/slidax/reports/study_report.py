"""The page of a study."""

from __future__ import annotations

from pathlib import Path

from slidax import figures
from slidax.scenarios.written import as_yaml
from slidax.studies import AbstractResult, AbstractStudy, Drawn

from .page import write_page
from .parameters import write_scenario
from .picture import Picture, picture


def write_study_report(
    study: AbstractStudy, result: AbstractResult, out: Path, *, seconds: float, command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg`, `results.json` and scenarios to the folder `out`; return the page's path.

    - `study`, `result`: a study and its result.
    - `seconds`, `command`: computing time and command line, for the page.
    """
    scenarios = result.scenarios()
    for name, description in scenarios.items():
        write_scenario(description, out / f"{name}.yaml")
    sections = [
        (section, [_picture(chart, out / "figures") for chart in section.figures]) for section in result.sections()
    ]
    return write_page(
        out,
        "study.html.j2",
        data={"results.json": result.as_json()},
        title=study.title or f"{study.scenario}: {study.study.replace('_', ' ')}",
        kind=study.study.replace("_", " "),
        result=result,
        sections=sections,
        scenarios={name: as_yaml(description) for name, description in scenarios.items()},
        parameters={"The study": as_yaml(study)},
        seconds=seconds,
        command=command,
    )


def _picture(chart: Drawn, folder: Path) -> Picture:
    figure = getattr(figures, chart.kind)(*chart.values)
    return picture(figure, folder, chart.name, chart.title, chart.caption)
