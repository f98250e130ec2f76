"""Several schemes on the same task: their metrics beside each other, and who has the least."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from slidax import metrics
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .run_report import PER_JOINT

BEST_IS_LEAST = frozenset(PER_JOINT) - {"envelope_margin"}
"""The metrics of which less is better; the settling times are too."""


@dataclass(frozen=True)
class Row:
    """One metric of one joint.

    - `metric`: its place in the metrics, such as `iae` or `settling_time.1e-3`.
    - `name`: what it is called.
    - `joint`: number of the joint, from 1.
    - `unit`: of the values.
    - `values`: of each scheme by name; None where there is none.
    - `best`: the schemes with the least value, among the runs that reached their end.
    """

    metric: str
    name: str
    joint: int
    unit: str
    values: dict[str, float | None]
    best: frozenset[str]


def standings(scenario_runs: Mapping[str, tuple[Scenario, Run]]) -> list[Row]:
    """All metrics joint by joint.

    - `scenario_runs`: each scheme's scenario and finished run, by name; all on the same arm.
    """
    scenario, first = next(iter(scenario_runs.values()))
    summaries = {name: metrics.summary(run) for name, (_, run) in scenario_runs.items()}
    reached = [name for name, (_, run) in scenario_runs.items() if run.outcome.ok]
    units = list(zip(first.joint_units, scenario.plant.robot.torque_units, strict=True))
    rows = []
    for band in next(iter(summaries.values()))["settling_time"]:
        for i in range(first.joints):
            times = {
                name: _settled(summaries[name]["settling_time"][band][i], run)
                for name, (_, run) in scenario_runs.items()
            }
            # Who is above the band in the last quarter has not settled, even if the very last sample is below.
            settled = [name for name in reached if (times[name] or 0.0) < 0.75 * scenario.t1]
            best = _least(times, settled)
            rows.append(Row(f"settling_time.{band}", f"last time with |e| above {band}", i + 1, "s", times, best))
    for key, (name, unit) in PER_JOINT.items():
        for i, pair in enumerate(units):
            values = {scheme: _finite(summary[key], i) for scheme, summary in summaries.items()}
            best = _least(values, reached) if key in BEST_IS_LEAST else frozenset()
            rows.append(Row(key, name, i + 1, unit.format(*pair).replace("(N)", "N"), values, best))
    return rows


def results(scenario_runs: Mapping[str, tuple[Scenario, Run]]) -> dict[str, Any]:
    """What came of the comparison, ready for JSON: no value in it is infinite or not a number.

    - `scenario_runs`: each scheme's scenario and finished run, by name; all on the same arm.
    """
    scenario, first = next(iter(scenario_runs.values()))
    best: dict[str, list[list[str]]] = {}
    for row in standings(scenario_runs):
        best.setdefault(row.metric, []).append([name for name in row.values if name in row.best])
    return {
        "scenario": scenario.name,
        "robot": scenario.robot,
        "n": first.joints,
        "period": scenario.period,
        "t1": scenario.t1,
        "schemes": {name: _result(run) for name, (_, run) in scenario_runs.items()},
        "best": best,
    }


def _result(run: Run) -> dict[str, Any]:
    outcome, timing = run.outcome, run.timing
    times = {"compile_s": round(timing.compile_s, 4), "run_s": round(timing.run_s, 4)} if timing else None
    cleaned: dict[str, Any] = _cleaned(
        {
            "outcome": outcome.kind,
            "stopped": outcome.stopped,
            "metrics": metrics.summary(run),
            "timing": times,
        }
    )
    return cleaned


def _cleaned(value: Any) -> Any:
    """JSON knows no NaN and no infinity: they become null."""
    if isinstance(value, dict):
        return {key: _cleaned(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_cleaned(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _settled(time: float, run: Run) -> float | None:
    """None if the error was still above the band at the last sample."""
    last = (int(run.tally.samples) - 1) * float(run.period)
    return time if time < last - 1e-9 else None


def _finite(values: list[float] | None, joint: int) -> float | None:
    return values[joint] if values is not None and math.isfinite(values[joint]) else None


def _least(values: Mapping[str, float | None], among: list[str]) -> frozenset[str]:
    """Nobody stands out where there is one only, or where all are alike."""
    known = {name: value for name in among if (value := values[name]) is not None}
    if len(values) < 2 or not known:
        return frozenset()
    least = min(known.values())
    best = frozenset(name for name, value in known.items() if value == least)
    return best if len(best) < len(values) else frozenset()
