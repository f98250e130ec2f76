"""What the certificates say of the paper's two examples, beside what runs show."""

from __future__ import annotations

import numpy as np
from sampled_data_figures.loops import table, write_table

from slidax import metrics
from slidax.certificates.arm import uncertainty_bound
from slidax.certificates.continuous import printed_period, settling_time, ultimate_bound
from slidax.certificates.continuous.law import PrintedLaw
from slidax.papers.cftsmppc.bounds import inverse_inertia
from slidax.scenarios import Scenario, load

EXAMPLES = ("example-4.1", "example-4.2")
PAGE = "certificates/paper.md"
GROWTH = 20.0
"""A loop chatters where its steady torque steps are so many times those at half the period."""

FINENESS = 0.002
"""Of the period that is searched, relative to it."""


def _settled(scenario: Scenario) -> float:
    """When the last joint was last out of its core."""
    law, run = PrintedLaw.of(scenario), scenario.simulate(log_every=1)
    assert law is not None
    assert law.powers is not None
    assert run.log is not None
    t, e = np.asarray(run.log.t), np.asarray(run.log.e)
    sides, radius = law.places(np.stack([law.powers.delta, -law.powers.delta])), law.radius(t)
    outside = ((e > sides[0] * radius) | (e < sides[1] * radius)).any(axis=1)
    return float(t[outside].max())


def _times(name: str) -> list[str]:
    scenario = load(name)
    bound = settling_time(scenario).bound
    reaching = bound["reaching"]
    cells = [reaching["printed"], np.max(bound["printed"]), reaching["supremum"], np.max(bound["supremum"])]
    cells += [np.max(bound["given_start"]), np.max(bound["deadline"]), _settled(scenario)]
    return [f"`{name}`", *(f"{cell:.3g}" for cell in cells)]


def _inertia(name: str) -> list[str]:
    found = inverse_inertia(load(name))
    return [
        f"`{name}`",
        f"{found['m1']:g}, {found['m2']:g}",
        *(" to ".join(f"{value:.3g}" for value in found[norm]) for norm in ("eigenvalues", "spectral", "frobenius")),
        f"{found['mismatch']:.3g}",
        f"{found['gamma']:.3g}",
    ]


def _step(name: str, period: float) -> float:
    """The largest torque step over the last quarter; infinite for a run that ends badly."""
    run = load(name, {"simulation.mode": "held", "simulation.period": period}).simulate(log_every=None)
    return float(np.max(metrics.steady_torque_step(run))) if run.outcome.ok else np.inf


def _whole(name: str, period: float) -> float:
    """The nearest period of which a run has a whole number."""
    t1 = load(name).t1
    return t1 / round(t1 / period)


def _period(name: str) -> list[str]:
    bound = printed_period(load(name)).bound
    limit = bound["limit"]
    calm = _step(name, _whole(name, 0.5 * limit))
    low, high = 0.7 * limit, 1.4 * limit
    while high / low > 1.0 + FINENESS:
        middle = np.sqrt(low * high)
        chatters = _step(name, _whole(name, middle)) > GROWTH * calm
        low, high = (low, middle) if chatters else (middle, high)
    return [
        f"`{name}`",
        *(f"{1e3 * value:.3g}" for value in (bound["surface"], bound["layer"], limit, bound["period"], high)),
    ]


def _error(scale: float) -> list[str]:
    scenario = load("example-4.2", {"disturbance.scale": scale})
    verdict = ultimate_bound(scenario)
    run = scenario.simulate(log_every=None)
    seen = float(np.max(metrics.steady_error(run)))
    bound = float(np.max(verdict.bound["error"])) if verdict.holds else np.nan
    cells = (bound, float(np.max(verdict.bound["estimate"])), seen)
    return [f"{scale:g}", *("-" if np.isnan(cell) else f"{cell:.2g}" for cell in cells)]


def _bound(name: str) -> list[str]:
    found = uncertainty_bound(load(name)).bound
    return [f"`{name}`", *(f"{float(found[key]):.3g}" for key in ("gamma", "b0", "b1", "b2"))]


def make() -> None:
    """Measures, and writes the tables."""
    head = ["example", "T_r printed", "T_max printed", "T_r unsplit", "unsplit", "this start", "T_i", "observed"]
    write_table(PAGE, "times", table(head, [_times(name) for name in EXAMPLES]))
    head = ["example", "m1, m2", "eigenvalues of M⁻¹", "spectral", "Frobenius", "max of M⁻¹M0 - I", "γ"]
    write_table(PAGE, "inertia", table(head, [_inertia(name) for name in EXAMPLES]))
    head = ["example", "surface [ms]", "layer [ms]", "both [ms]", "bound [ms]", "observed [ms]"]
    write_table(PAGE, "period", table(head, [_period(name) for name in EXAMPLES]))
    head = ["disturbance", "bound", "estimated", "observed"]
    write_table(PAGE, "error", table(head, [_error(scale) for scale in (0.5, 1.0, 2.0)]))
    head = ["example", "γ", "b0 [N m]", "b1 [N m/rad]", "b2 [N m s²/rad²]"]
    write_table(PAGE, "uncertainty", table(head, [_bound(name) for name in EXAMPLES]))
