"""The smallest change of one number with which a promise holds, by bisection over its own inequality."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario
from slidax.scenarios.load import validated

from ..demand import Demand

Floats = NDArray[np.floating[Any]]
Share = Callable[[Scenario, Demand], float]

HALVINGS = 5
"""Steps of a bisection: the number is found within a thirtieth of the decade that is searched."""


def found_remedies(scenario: Scenario, demand: Demand, radius: Floats, share: Share) -> list[Remedy]:
    """What alone would make it hold, the least change first: ρ∞, H, h, encoders, or a smaller set.

    - `scenario`, `demand`: for which it does not hold.
    - `radius`: final radii that are certified [n]; nan where none was found.
    - `share`: of an envelope that may be reached, below 1 where it holds.
    """
    found = []
    if np.all(np.isfinite(radius)):
        wider = [float(f"{1.02 * one:.3g}") for one in radius]
        found.append(Remedy("a wider final radius", {"scheme.performance.final": wider}))
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
    if not scenario.changed:
        for words, path, now, end in ways:
            value = _least(partial(_changed, scenario, demand, share, path), now, end)
            if value is not None:
                found.append(Remedy(f"{words}, {value:.3g}", {path: value}))
    part = _least(lambda part: share(scenario, scaled(demand, part)), 1.0, 0.05)
    if part is not None:
        found.append(Remedy(f"{part:.2g} of what is uncertain, such as the payload", {}))
    return found


def scaled(demand: Demand, part: float) -> Demand:
    """A set that is so many times as large around the arm that the law believes in.

    - `demand`: of the set.
    - `part`: of each of its numbers; κ is scaled in its logarithm.
    """
    return replace(
        demand,
        push=part * demand.push,
        stray=part * demand.stray,
        kappa=np.asarray(demand.kappa) ** part,
        coupling=part * demand.coupling,
    )


def resampled(demand: Demand, period: float) -> Demand:
    """The same at another period.

    - `demand`: at its own.
    - `period`: h [s].
    """
    times = np.arange(int(np.floor(demand.times[-1] / period + 1e-9)) + 1) * period

    def at(values: Floats) -> Floats:
        return np.stack([np.interp(times, demand.times, one) for one in values.T], axis=1)

    push = np.stack([at(one) for one in demand.push])
    return replace(demand, times=times, push=push, stray=at(np.asarray(demand.stray)))


def _changed(scenario: Scenario, demand: Demand, share: Share, path: str, value: float) -> float:
    base = scenario.description
    try:
        other = validated(base.model_dump(exclude_unset=True), {path: value}, form=type(base)).build(scenario.name)
    except DefinitionError:
        return float("inf")
    if path == "simulation.period":
        demand = resampled(demand, value)
    return share(other, demand)


def _least(share: Callable[[float], float], now: float, end: float) -> float | None:
    """The value nearest to the present one for which it holds, in steps of the logarithm; None if it does at no end."""
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
