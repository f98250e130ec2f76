"""The parts of a page that all studies of many cases have: metrics, margins, the worst case."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from slidax.diagnosis import first_line
from slidax.metrics import METRICS
from slidax.scenarios.family import Family

from .result import Drawn, Section
from .table import Columns
from .task import flat

SHOWN = ("steady_error", "peak_torque", "max_torque_step", "rms_error")
"""Metrics whose distribution is drawn, beside the margin."""

MOST_PANELS = 9

SECONDS = 20.0
"""For remedies to be tried when every run failed."""


def overview(family: Family, table: Columns, worst: Mapping[str, Any], row: int) -> list[Section]:
    """Metrics over all runs, the margin over what is uncertain, and the worst case.

    - `family`: of scenarios.
    - `table`: the rows.
    - `worst`: the values of the worst row, by path.
    - `row`: its number.
    """
    return [_metrics(table), *_margins(family, table), _worst(family, table, worst, row)]


def why_it_failed(family: Family, worst: Mapping[str, Any]) -> str:
    """The likeliest reason and its remedy in a line; empty if none is found.

    - `family`: of scenarios.
    - `worst`: the values of a case that failed, by path.
    """
    return first_line(family.scenario(worst, "worst"), seconds=SECONDS)


def share(value: float) -> str:
    """A probability with the digits that matter: 0.99947, and not 1.

    - `value`: in [0, 1].
    """
    near = min(value, 1.0 - value)
    if near <= 0:
        return f"{value:g}"
    text = f"{value:.{max(2, 2 - int(np.floor(np.log10(near))))}f}"
    return text.rstrip("0").rstrip(".")


def _metrics(table: Columns) -> Section:
    from slidax import figures

    rows = []
    for one in METRICS:
        numbers = table.get(one.key)
        if numbers is None or np.isnan(numbers).all():
            continue
        unit = one.unit.format(position="rad or m", torque="N m or N")
        low, middle, high = np.nanquantile(numbers, [0.0, 0.5, 1.0])
        tail = float(np.nanquantile(numbers, 0.99 if one.least_is_best else 0.01))
        rows.append((one.title, float(low), float(middle), tail, float(high), unit))
    drawn = {"envelope margin": table["margin"]}
    drawn |= {
        f"{one.title}  [{one.unit.format(position='rad or m', torque='N m or N')}]": table[one.key]
        for one in METRICS
        if one.key in SHOWN
    }
    picture = Drawn(
        "distributions",
        "Distributions",
        "How many runs have which value, of the worst joint.",
        figures.histograms(
            {name: values for name, values in drawn.items() if np.isfinite(values).any()}, {"envelope margin": 0.0}
        ),
    )
    return Section(
        "Metrics",
        "Of the worst joint, over all runs; of 100 runs one is beyond the third number.",
        ("Metric", "least", "median", "1 of 100", "largest", ""),
        rows,
        [picture],
    )


def _margins(family: Family, table: Columns) -> list[Section]:
    from slidax import figures

    margin = table["margin"]
    if np.isnan(margin).all():
        return []
    columns = flat_names(family, table)
    known = np.isfinite(margin)
    varies = np.ptp(margin[known]) > 0
    strength = {}
    for name in columns:
        numbers = np.asarray(table[name], float)[known]
        if len(numbers) > 2 and np.ptp(numbers) > 0:
            strength[name] = abs(float(spearmanr(numbers, margin[known]).statistic)) if varies else 0.0
    strongest = sorted(strength, key=lambda name: -strength[name])[:MOST_PANELS]
    if not strongest:
        return []
    shown = {_label(family, name): table[name] for name in columns if name in strongest}
    note = f" The {len(strongest)} that it follows most, of {len(strength)}." if len(strength) > len(strongest) else ""
    picture = Drawn("margin", "Margin", f"Over what is uncertain.{note}", figures.margin_over(margin, shown))
    return [Section("What the margin depends on", "", figures=[picture])]


def flat_names(family: Family, table: Columns) -> list[str]:
    """The columns of a table that are values of cases.

    - `family`: of scenarios.
    - `table`: the rows.
    """
    return [name for name in table if name.partition("[")[0] in family.space.sets]


def _label(family: Family, name: str) -> str:
    path, bracket, place = family.label(name).partition("[")
    unit = family.space.leaves[name.partition("[")[0]].unit
    short = ".".join(path.split(".")[-2:]) + bracket + place
    return f"{short}  [{unit}]" if unit else short


def _worst(family: Family, table: Columns, worst: Mapping[str, Any], row: int) -> Section:
    values = flat({path: np.asarray(value)[None] for path, value in worst.items()})
    rows: list[tuple[str, float, str]] = []
    for name, value in values.items():
        rows.append((family.label(name), float(value[0]), family.space.leaves[name.partition("[")[0]].unit))
    margin = float(table["margin"][row])
    said = f"margin {margin:.4g} of the envelope's width" if np.isfinite(margin) else "without an envelope"
    return Section(
        "The worst case",
        f"Row {row}, {said}. `slidax run worst.yaml` replays it, bit for bit on the same machine.",
        ("Value", "", ""),
        rows,
    )
