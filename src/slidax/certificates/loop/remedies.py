"""The smallest change of one number with which a promise holds, by bisection over its own inequality."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError
from slidax.diagnosis import Remedy
from slidax.scenarios import Scenario
from slidax.scenarios.load import validated

from ..demand import Demand

Floats = NDArray[np.floating[Any]]
Share = Callable[[Scenario], float]

HALVINGS = 5
"""Steps of a bisection: the number is found within a thirtieth of the decade that is searched."""


def found_remedies(
    scenario: Scenario, radius: Floats, share: Share, of_a_part: Callable[[float], float]
) -> list[Remedy]:
    """What alone would make it hold: ρ∞, H, h, encoders, or a smaller set; the nearest value of each.

    - `scenario`: for which it does not hold.
    - `radius`: final radii that are asked for [n].
    - `share`: of an envelope that may be reached, below 1 where it holds.
    - `of_a_part`: the same for a set that is so many times as large.
    """
    found = []
    wider = [float(f"{1.05 * one:.3g}") for one in radius]
    other = altered(scenario, {"scheme.performance.final": wider}) if np.all(np.isfinite(radius)) else None
    if other is not None and share(other) < 1.0:
        found.append(Remedy("a wider final radius", {"scheme.performance.final": wider}))
    if not scenario.changed:
        for words, path, now, end in _ways(scenario):
            value = least(lambda value, path=path: _with(scenario, path, value, share), now, end)  # type: ignore[misc]
            if value is not None:
                found.append(Remedy(f"{words}, {value:.3g}", {path: value}))
    part = least(of_a_part, 1.0, 0.05)
    if part is not None:
        found.append(Remedy(f"{part:.2g} of what is uncertain, such as the payload", {}))
    return found


def tried(scenario: Scenario, share: Share) -> list[Remedy]:
    """What alone would make it hold, of one other value of H, h and the encoders each.

    - `scenario`: for which it does not hold.
    - `share`: of an envelope that may be reached, below 1 where it holds.
    """
    found = []
    for words, path, now, end in _ways(scenario):
        value = float(f"{np.sqrt(now * end):.3g}")
        if _with(scenario, path, value, share) < 1.0:
            found.append(Remedy(f"{words}, {value:.3g}", {path: value}))
    return found


def _ways(scenario: Scenario) -> list[tuple[str, str, float, float]]:
    """Numbers of the law and its surroundings, each with where it stands and how far it may go."""
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


def altered(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario | None:
    """A scenario with other numbers; None if there is no such scenario.

    - `scenario`: as it is.
    - `changes`: by path.
    """
    base = scenario.description
    try:
        return validated(base.model_dump(exclude_unset=True), dict(changes), form=type(base)).build(scenario.name)
    except DefinitionError:
        return None


def _with(scenario: Scenario, path: str, value: float, share: Share) -> float:
    other = altered(scenario, {path: value})
    return float("inf") if other is None else share(other)


def scaled(demand: Demand, part: float) -> Demand:
    """A set that is so many times as large around the arm that the law believes in.

    - `demand`: of the set.
    - `part`: of each of its numbers; κ is scaled in its logarithm.
    """
    beside, relearnt = demand.beside, demand.relearnt
    return replace(
        demand,
        push=part * demand.push,
        stray=part * demand.stray,
        kappa=np.asarray(demand.kappa) ** part,
        coupling=part * demand.coupling,
        effects=None if demand.effects is None else part * demand.effects,
        beside=None if beside is None else lambda radius, speed: part * beside(radius, speed),
        relearnt=None if relearnt is None else part * relearnt,
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


def least(share: Callable[[float], float], now: float, end: float) -> float | None:
    """The value nearest to the present one for which it holds, in steps of the logarithm; None if it does at no end.

    - `share`: below 1 where it holds.
    - `now`, `end`: between which is looked.
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
