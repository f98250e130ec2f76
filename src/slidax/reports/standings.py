"""Metrics of several schemes on the same task, with the best scheme for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from slidax.metrics import Metric, metrics_of, summary

from .rival import Rival


@dataclass(frozen=True)
class Row:
    """One metric of one joint.

    - `values`: by scheme, in `unit`; None where there is none.
    - `best`: the schemes with the least value, among the runs that reached their end.
    - `metric`, `joint`: which.
    """

    metric: Metric[Any]
    joint: str
    unit: str
    values: dict[str, float | None]
    best: frozenset[str]


def standings(rivals: Mapping[str, Rival], also: Sequence[Metric[Any]] = ()) -> list[Row]:
    """All metrics joint by joint.

    - `rivals`: runs by scheme, all on the same arm.
    - `also`: further metrics, such as those of a paper; listed for scenarios from their source.
    """
    first = next(iter(rivals.values()))
    reached = [name for name, rival in rivals.items() if rival.run.outcome.ok]
    rows = []
    for metric in (*metrics_of(first.run), *also):
        if not metric.per_joint or metric.source not in first.scenario.description.source:
            continue
        shown = {name: metric.shown(rival.run) for name, rival in rivals.items()}
        for i, (joint, unit) in enumerate(zip(first.run.joint_names, metric.units(first.run), strict=True)):
            values = {name: each[i] for name, each in shown.items()}
            among = reached if metric.least_is_best else []
            if metric.needs_settling:
                # A run above the band in the last quarter has not settled, even if its last sample is below.
                among = [name for name in among if (values[name] or 0.0) < 0.75 * first.scenario.t1]
            rows.append(Row(metric, joint, unit, values, _least(values, among)))
    return rows


def results(rivals: Mapping[str, Rival], also: Sequence[Metric[Any]] = ()) -> dict[str, Any]:
    """The comparison of `rivals` by all metrics and those in `also`, ready for JSON: every number in it is finite."""
    first = next(iter(rivals.values()))
    scenario = first.scenario
    best: dict[str, list[list[str]]] = {}
    for row in standings(rivals, also):
        best.setdefault(row.metric.key, []).append([name for name in row.values if name in row.best])
    return {
        "scenario": scenario.name,
        "robot": scenario.robot,
        "n": first.run.joints,
        "joints": list(first.run.joint_names),
        "period": scenario.period,
        "t1": scenario.t1,
        "schemes": {name: _result(rival, also) for name, rival in rivals.items()},
        "best": best,
    }


def _result(rival: Rival, also: Sequence[Metric[Any]]) -> dict[str, Any]:
    outcome, timing = rival.run.outcome, rival.run.timing
    return {
        "form": rival.form,
        "outcome": outcome.kind,
        "stopped": outcome.stopped,
        "samples_outside": rival.outside,
        "metrics": summary(rival.run, also),
        "timing": {"compile_s": round(timing.compile_s, 4), "run_s": round(timing.run_s, 4)} if timing else None,
    }


def _least(values: Mapping[str, float | None], among: list[str]) -> frozenset[str]:
    """Empty if there is only one scheme, or all values are equal."""
    known = {name: value for name in among if (value := values[name]) is not None}
    if len(values) < 2 or not known:
        return frozenset()
    least = min(known.values())
    best = frozenset(name for name, value in known.items() if value == least)
    return best if len(best) < len(values) else frozenset()
