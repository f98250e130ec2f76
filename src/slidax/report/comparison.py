"""Comparison of schemes in the same scenario: runs, metrics of each joint, and an HTML report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.analysis.metric import Metric, short_names
from slidax.analysis.metrics import metrics_of, steady_error, steady_torque_step, summary
from slidax.analysis.run_verdict import RunVerdict, torque_limits
from slidax.core.errors import DefinitionError
from slidax.law.sampled.controller import SampledData
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run

from . import figures
from .figures.compared import LOOKS
from .files import parameters
from .page import Picture, picture, write_page
from .pages import tip_paths


@dataclass(frozen=True)
class Rival:
    """The run of one scheme in a comparison.

    - `scenario`, `run`: the simulated scenario and its run.
    - `outside`: number of samples outside the scheme's envelope; for a scheme without one, outside the envelope of the
      compared scenario's own scheme. None if neither has an envelope.
    """

    scenario: Scenario
    run: Run
    outside: int | None = None

    @property
    def form(self) -> str:
        """`sampled-data` for a law that is designed for its sample time, `printed` for a law as published."""
        return "sampled-data" if isinstance(self.scenario.controller, SampledData) else "printed"

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return max(0, int(self.run.tally.samples) - 1) * float(self.run.period)

    @classmethod
    def simulated(cls, scenario: Scenario, judge: Scenario, *, logged: bool) -> Rival:
        """Simulate a scheme and count its samples outside the envelope.

        - `scenario`: the scenario to simulate.
        - `judge`: the scenario whose envelope is used if the scheme has none.
        - `logged`: True to keep the log that the scenario requests, False for a run without a log.
        """
        # Log every sample to count those outside: the metrics use every sample, too.
        run = scenario.simulate(log_every=1)
        outside = int(run.tally.violations) if run.has_envelope else _outside(judge, run)
        kept = jax.tree.map(lambda x: x[:: scenario.log_every].copy(), run.log) if logged else None
        return cls(scenario, eqx.tree_at(lambda r: r.log, run, kept), outside)


def _outside(judge: Scenario, run: Run) -> int | None:
    """Return the number of logged samples with a joint at or outside another scenario's envelope; None without one."""
    law, start = judge.controller, jnp.zeros(())
    memory = law.init(start, judge.state0, judge.trajectory.reference(start))
    if run.log is None or law.envelope(start, memory) is None:
        return None
    bounds: Any = jax.jit(jax.vmap(law.envelope, (0, None)))(jnp.asarray(run.log.t), memory)
    inside = (np.asarray(bounds.lower) < run.log.e) & (run.log.e < np.asarray(bounds.upper))
    return int(np.sum(~inside.all(axis=1)))


@dataclass(frozen=True)
class MetricRow:
    """One metric of one joint.

    - `metric`, `joint`: the metric, and the joint's name.
    - `values`: the value of each scheme, by its name, in `unit`; None for a missing value.
    - `best`: names of the schemes with the least value, among the runs that reached their end; empty for a metric
      whose larger values are better.
    """

    metric: Metric[Any]
    joint: str
    unit: str
    values: dict[str, float | None]
    best: frozenset[str]


def standings(rivals: Mapping[str, Rival], also: Sequence[Metric[Any]] = ()) -> list[MetricRow]:
    """Return a row for each metric and joint.

    - `rivals`: runs by name of the scheme, all on the same arm.
    - `also`: additional metrics. A metric defined in a paper is listed only for scenarios from this paper.
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
            rows.append(MetricRow(metric, joint, unit, values, _least(values, among)))
    return rows


RANKED = {"steady error": steady_error, "steady torque step": steady_torque_step}
"""Metrics of the verdict, by their names in a sentence."""


def comparison_verdict(rivals: Mapping[str, Rival]) -> RunVerdict:
    """Return which schemes stay inside the envelope, and which of these are best by the metrics in `RANKED`.

    The verdict is good if any scheme stays inside; without an envelope, if any reaches its end.
    """
    judged = any(rival.outside is not None for rival in rivals.values())
    kept = [name for name, rival in rivals.items() if rival.run.outcome.ok and (not judged or rival.outside == 0)]
    where = "inside the envelope" if judged else "finite to the end"
    listed = ", ".join(f"`{name}`" for name in kept)
    if len(kept) == len(rivals):
        who = {1: f"{listed} stays", 2: "Both schemes stay"}.get(len(kept), f"All {len(kept)} schemes stay")
        sentence = f"{who} {where}."
    elif kept:
        verb = "stays" if len(kept) == 1 else "stay"
        sentence = f"{len(kept)} of {len(rivals)} schemes {verb} {where}: {listed}."
    else:
        sentence = f"No scheme stays {where}."
    return RunVerdict(bool(kept), sentence, tuple(_leaders({name: rivals[name].run for name in kept})))


def _leaders(runs: Mapping[str, Run]) -> list[str]:
    """Return a sentence that names the best of at least two runs, for each metric in `RANKED` with a single unit."""
    facts = []
    for title, metric in RANKED.items():
        shown = {name: [value for value in metric.shown(run) if value is not None] for name, run in runs.items()}
        worst = {name: max(values) for name, values in shown.items() if len(values) == runs[name].joints}
        units = {unit for run in runs.values() for unit in metric.units(run)}
        if len(worst) > 1 and len(units) == 1:
            best = min(worst, key=worst.__getitem__)
            facts.append(f"`{best}` has the smallest {title}, {worst[best]:.2g} {units.pop()} (worst joint).")
    return facts


def results(rivals: Mapping[str, Rival], also: Sequence[Metric[Any]] = ()) -> dict[str, Any]:
    """Return the contents of `results.json`, with finite numbers only: the scenario, and the metrics of each scheme.

    - `rivals`, `also`: as in `standings`.
    """
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
    """Return the schemes with the least value; none if there is only one scheme, or all values are equal."""
    known = {name: value for name in among if (value := values[name]) is not None}
    if len(values) < 2 or not known:
        return frozenset()
    least = min(known.values())
    best = frozenset(name for name, value in known.items() if value == least)
    return best if len(best) < len(values) else frozenset()


ACROSS = 5
"""Largest number of schemes in a table."""


def write_comparison(
    rivals: Mapping[str, Rival], out: str | Path, *, also: Sequence[Metric[Any]] = (), command: str = ""
) -> Path:
    """Write `report.html`, `figures/*.svg` and `results.json` to the folder `out`, and return the page's path.

    - `rivals`: runs by name of the scheme; a run without a log appears in the tables only.
    - `also`: as in `standings`.
    - `command`: command line, for the page.

    Raises DefinitionError if there are no runs, or they belong to different arms.
    """
    if not rivals:
        raise DefinitionError("nothing to compare: give at least one run")
    first = next(iter(rivals.values()))
    if any(rival.run.joint_names != first.run.joint_names for rival in rivals.values()):
        raise DefinitionError("only runs of the same arm can be compared, and these runs have different joints")
    rows = standings(rivals, also)
    timings = [rival.run.timing for rival in rivals.values() if rival.run.timing]
    return write_page(
        out,
        "comparison.html.j2",
        data={"results.json": results(rivals, also)},
        scenario=first.scenario,
        rivals=rivals,
        verdict=comparison_verdict(rivals),
        tables=_tables(list(rivals)),
        groups=[(metric, list(group)) for metric, group in groupby(rows, key=lambda row: row.metric)],
        pictures=_pictures(rivals, rows, Path(out, "figures")),
        undrawn=[name for name in rivals if name not in _drawable(rivals)],
        parameters={name: parameters(rival.scenario) for name, rival in rivals.items()},
        seconds=sum(timing.compile_s + timing.run_s for timing in timings),
        command=command,
    )


def _tables(names: list[str]) -> list[list[str]]:
    """Split the names into as few tables as possible, each with at most `ACROSS` names, of nearly equal length."""
    tables = -(-len(names) // ACROSS)
    each = -(-len(names) // tables)
    return [names[start : start + each] for start in range(0, len(names), each)]


def _drawable(rivals: Mapping[str, Rival]) -> dict[str, Rival]:
    """Return the runs with at least two finite samples, at most as many as there are line styles."""
    return dict(islice(((name, rival) for name, rival in rivals.items() if _has_samples(rival.run)), len(LOOKS)))


def _has_samples(run: Run) -> bool:
    if run.log is None:
        return False
    samples = np.concatenate([np.asarray(part) for part in (run.log.e, run.log.de, run.log.tau)], axis=1)
    return int(np.isfinite(samples).all(axis=1).sum()) >= 2


def _pictures(rivals: Mapping[str, Rival], rows: list[MetricRow], folder: Path) -> list[Picture]:
    drawn = _drawable(rivals)
    if not drawn:
        return []
    runs = {name: rival.run for name, rival in drawn.items()}
    paths = {name: tip_paths(rival.scenario.plant.robot, rival.run) for name, rival in drawn.items()}
    desired = max((goal for _, goal in paths.values()), key=len)
    enveloped = [name for name, run in runs.items() if run.has_envelope]
    behind = f" Behind them lies the envelope of {enveloped[0]}." if len(enveloped) == 1 else ""
    specs = [
        (
            "tracking-errors",
            "Tracking errors",
            "Left: the beginning. Right: absolute values over the run; a point is the largest sample of an interval."
            + behind,
            figures.compared_errors(runs),
        ),
        (
            "velocity-errors",
            "Velocity errors",
            "Left: the beginning. Right: absolute values over the run, drawn in the same way.",
            figures.compared_velocity_errors(runs),
        ),
        (
            "torques",
            "Torques",
            "Left: the whole run. Right: its beginning. A tinted band is the range of a chattering torque; "
            "peaks far above all others are cut off.",
            figures.compared_torques(runs, limits=torque_limits(next(iter(drawn.values())).scenario)),
        ),
        (
            "tip-paths",
            "Paths of the tip",
            "Each path starts at a ring. The desired path is grey.",
            figures.compared_tip_paths({name: path for name, (path, _) in paths.items()}, desired),
        ),
    ]
    for metric, group in groupby((row for row in rows if row.metric.bars), key=lambda row: row.metric):
        metric_rows = list(group)
        bars = {name: [row.values[name] for row in metric_rows] for name in drawn}
        units = ", ".join(dict.fromkeys(row.unit for row in metric_rows))
        joints = short_names([row.joint for row in metric_rows])
        caption = f"{metric.meaning}, for each joint, on a logarithmic axis."
        figure = figures.metric_bars(bars, f"{metric.title}  [{units}]", joints)
        specs.append((metric.key, metric.title.capitalize(), caption, figure))
    return [picture(figure, folder, name, title, caption) for name, title, caption, figure in specs]
