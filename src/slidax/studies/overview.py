"""Sections common to several kinds of studies: metrics, margins, and the worst case."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from slidax.analysis.explain import likeliest_cause
from slidax.analysis.metric import Metric
from slidax.analysis.metrics import METRICS
from slidax.scenarios.family import Family

from .cases import Columns, flatten_values
from .study import Chart, Section

SHOWN = ("steady_error", "peak_torque", "max_torque_step", "rms_error")
"""Metrics whose distribution is plotted in addition to the margin's."""

MOST_PANELS = 9

SECONDS = 20.0
"""Time limit for trying remedies in simulation if every run failed [s]."""


def overview(family: Family, table: Columns, worst: Mapping[str, Any], row: int) -> list[Section]:
    """Return sections of a study's page: on metrics, on the margin over uncertain values, and on the worst case.

    - `family`, `table`: scenarios of the study, and its rows.
    - `worst`, `row`: uncertain values of the worst row by dotted path, and the row's number.
    """
    return [_metrics(family, table), *_margins(family, table), _worst(family, table, worst, row)]


def failure_reason(family: Family, worst: Mapping[str, Any]) -> str:
    """Return the likeliest reason for a failed case, and its remedy, in a line; empty if no reason is known.

    - `worst`: uncertain values of the case, by dotted path.
    """
    return likeliest_cause(family.scenario(worst, "worst"), seconds=SECONDS)


def share(value: float) -> str:
    """Format a probability with enough digits to show its distance from 0 or 1: 0.99947, and not 1."""
    near = min(value, 1.0 - value)
    if near <= 0:
        return f"{value:g}"
    text = f"{value:.{max(2, 2 - int(np.floor(np.log10(near))))}f}"
    return text.rstrip("0").rstrip(".")


def _metrics(family: Family, table: Columns) -> Section:
    rows = []
    for metric in METRICS:
        numbers = table.get(metric.key)
        if numbers is None or np.isnan(numbers).all():
            continue
        unit = _metric_unit(family, metric)
        low, middle, high = np.nanquantile(numbers, [0.0, 0.5, 1.0])
        tail = float(np.nanquantile(numbers, 0.99 if metric.least_is_best else 0.01))
        rows.append((metric.title, float(low), float(middle), tail, float(high), unit))
    drawn = {"envelope margin": table["margin"]}
    drawn |= {
        f"{metric.title}  [{_metric_unit(family, metric)}]": table[metric.key]
        for metric in METRICS
        if metric.key in SHOWN
    }
    picture = Chart(
        "distributions",
        "Distributions",
        "Number of runs over the value of the worst joint.",
        "histograms",
        ({name: values for name, values in drawn.items() if np.isfinite(values).any()}, {"envelope margin": 0.0}),
    )
    return Section(
        "Metrics",
        "Values of the worst joint over all runs. One run in 100 is worse than “Worst 1 %”.",
        ("Metric", "Least", "Median", "Worst 1 %", "Largest", ""),
        rows,
        [picture],
    )


def _unit(family: Family, unit: str) -> str:
    """Return a unit such as "rad or m" as it applies to the arm's joints: "rad", "m", or both."""
    revolute, separator, prismatic = unit.partition(" or ")
    kinds = set(family.arm.joint_units)
    return unit if not separator or len(kinds) > 1 else revolute if kinds == {"rad"} else prismatic


def _metric_unit(family: Family, metric: Metric[Any]) -> str:
    return metric.unit.format(position=_unit(family, "rad or m"), torque=_unit(family, "N m or N"))


def _margins(family: Family, table: Columns) -> list[Section]:
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
    note = f", the {len(strongest)} of {len(strength)} that correlate most" if len(strength) > len(strongest) else ""
    picture = Chart("margin", "Margin", f"Over uncertain values{note}.", "margin_over", (margin, shown))
    return [Section("Dependence of the margin", "", figures=[picture])]


def flat_names(family: Family, table: Columns) -> list[str]:
    """Return the names of those columns of a table that contain the cases' uncertain or varied values."""
    return [name for name in table if name.partition("[")[0] in family.space.sets]


def _label(family: Family, name: str) -> str:
    path, bracket, index = family.label(name).partition("[")
    unit = _unit(family, family.space.leaves[name.partition("[")[0]].unit)
    short = ".".join(path.split(".")[-2:]) + bracket + index
    return f"{short}  [{unit}]" if unit else short


def _worst(family: Family, table: Columns, worst: Mapping[str, Any], row: int) -> Section:
    values = flatten_values({path: np.asarray(value)[None] for path, value in worst.items()})
    rows: list[tuple[str, float, str]] = []
    for name, value in values.items():
        unit = _unit(family, family.space.leaves[name.partition("[")[0]].unit)
        rows.append((family.label(name), float(value[0]), unit))
    margin = float(table["margin"][row])
    margin_text = f"margin {margin:.4g} of the envelope's width" if np.isfinite(margin) else "without an envelope"
    return Section(
        "The worst case",
        f"Row {row}, {margin_text}. `slidax run worst.yaml` replays it, bit for bit on the same machine.",
        ("Value", "", ""),
        rows,
    )
