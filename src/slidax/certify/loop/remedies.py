"""Remedies: the smallest change of one value with which a bound holds, found by bisection."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.errors import DefinitionError
from slidax.scenarios.load import validate_text
from slidax.scenarios.scenario import Scenario

from ..arm.demand import Demand
from ..sampled_scenario import Floats

Share = Callable[[Scenario], float]

HALVINGS = 5
"""Steps of a bisection: the result is within a thirtieth of the searched decade."""


def search_remedies(
    scenario: Scenario, radius: Floats, share: Share, of_a_part: Callable[[float], float]
) -> list[Remedy]:
    """Search changes that each make the bound hold: ρ∞, H, h, encoders, or a smaller set; the nearest value of each.

    - `radius`: required final radii [n].
    - `share`: reachable share of an envelope, below 1 where the bound holds.
    - `of_a_part`: the share for a set scaled by a factor.
    """
    fixes = []
    wider = [float(f"{1.05 * final:.3g}") for final in radius]
    other = with_changes(scenario, {"scheme.performance.final": wider}) if np.all(np.isfinite(radius)) else None
    if other is not None and share(other) < 1.0:
        fixes.append(Remedy("a wider final radius", {"scheme.performance.final": wider}))
    if not scenario.changed:
        for words, path, now, end in _ways(scenario):
            value = nearest_value(lambda value, path=path: _with(scenario, path, value, share), now, end)  # type: ignore[misc]
            if value is not None:
                fixes.append(Remedy(f"{words}, {value:.3g}", {path: value}))
    part = nearest_value(of_a_part, 1.0, 0.05)
    if part is not None:
        fixes.append(Remedy(f"{part:.2g} of the uncertainty, such as the payload's", {}))
    return fixes


def try_remedies(scenario: Scenario, share: Share) -> list[Remedy]:
    """Try one other value of H, h and the encoders each.

    - `share`: reachable share of an envelope, below 1 where the bound holds.
    """
    fixes = []
    for words, path, now, end in _ways(scenario):
        value = float(f"{np.sqrt(now * end):.3g}")
        if _with(scenario, path, value, share) < 1.0:
            fixes.append(Remedy(f"{words}, {value:.3g}", {path: value}))
    return fixes


def _ways(scenario: Scenario) -> list[tuple[str, str, float, float]]:
    """Values of the law and its surroundings, each with its present value and the end of its range."""
    law: Any = scenario.controller
    h, horizon = float(law.period), float(law.horizon)
    ways: list[tuple[str, str, float, float]] = [
        ("a shorter horizon", "scheme.sampled_data.horizon", horizon, max(2.0 * h, 0.25 * horizon)),
        ("a longer horizon", "scheme.sampled_data.horizon", horizon, 4.0 * horizon),
        ("a shorter period", "simulation.period", h, 0.1 * h),
    ]
    resolution = float(np.max(np.asarray(scenario.description.sensor.resolution)))
    if resolution > 0.0:
        ways.append(("finer encoders", "sensor.resolution", resolution, 0.01 * resolution))
    return ways


def with_changes(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario | None:
    """Return a scenario with other values, by path; None if there is no such scenario."""
    base = scenario.description
    try:
        return validate_text(base.model_dump(exclude_unset=True), dict(changes), form=type(base)).build(scenario.name)
    except DefinitionError:
        return None


def _with(scenario: Scenario, path: str, value: float, share: Share) -> float:
    other = with_changes(scenario, {path: value})
    return float("inf") if other is None else share(other)


def scale_demand(demand: Demand, part: float) -> Demand:
    """Return the demand of a set scaled around the law's model.

    - `part`: factor of each of its values; κ is scaled in its logarithm.
    """
    deviation, relearning = demand.deviation, demand.relearning
    return replace(
        demand,
        disturbance=part * demand.disturbance,
        stray=part * demand.stray,
        kappa=np.asarray(demand.kappa) ** part,
        coupling=part * demand.coupling,
        effects=None if demand.effects is None else part * demand.effects,
        deviation=None if deviation is None else lambda radius, speed: part * deviation(radius, speed),
        relearning=None if relearning is None else part * relearning,
    )


def resample_demand(demand: Demand, period: float) -> Demand:
    """Return the demand at another period, s."""
    times = np.arange(int(np.floor(demand.times[-1] / period + 1e-9)) + 1) * period

    def at(values: Floats) -> Floats:
        return np.stack([np.interp(times, demand.times, signal) for signal in values.T], axis=1)

    disturbance = np.stack([at(signal) for signal in demand.disturbance])
    return replace(demand, times=times, disturbance=disturbance, stray=at(np.asarray(demand.stray)))


def nearest_value(share: Callable[[float], float], now: float, end: float) -> float | None:
    """Return the value nearest to the present one for which the bound holds, in logarithmic steps; None if none does.

    - `share`: below 1 where the bound holds.
    - `now`, `end`: ends of the search.
    """
    if share(end) >= 1.0:
        return None
    outside, inside = np.log(now), np.log(end)
    for _ in range(HALVINGS):
        middle = 0.5 * (outside + inside)
        if share(float(np.exp(middle))) < 1.0:
            inside = middle
        else:
            outside = middle
    return float(f"{np.exp(inside):.3g}")
