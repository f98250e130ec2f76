"""Settling times of the printed law: closed forms compared with quadrature, and bounds with runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import gamma

from slidax.certify.printed import settling_time, two_power_time
from slidax.certify.printed.printed_law import PrintedLaw
from slidax.certify.printed.settling_time import passage_time_bound
from slidax.certify.sampled_scenario import BatchedFunction
from slidax.law import SmoothFixedTime
from slidax.scenarios import Scenario, load

from .example import constant


def random_powers(rng: np.random.Generator) -> tuple[float, float, float, float]:
    a, b = np.exp(rng.uniform(-4, 4, 2))
    return float(a), float(rng.uniform(0.0, 0.95)), float(b), float(rng.uniform(1.05, 3.0))


def integral(a: float, p: float, b: float, q: float, low: float, high: float) -> float:
    """The integral over the logarithm, where the integrand is smooth."""

    def integrand(y: float) -> float:
        return 1.0 / (a * np.exp(y * (p - 1)) + b * np.exp(y * (q - 1)))

    return float(quad(integrand, np.log(low), np.log(high), epsabs=0, limit=200)[0])


def test_two_power_time_equals_the_integral() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        a, p, b, q = random_powers(rng)
        low, high = np.sort(np.exp(rng.uniform(-9, 9, 2)))
        wanted = integral(a, p, b, q, low, high)
        assert two_power_time(a, p, b, q, high, low) == pytest.approx(wanted, rel=1e-7)
        whole = gamma((1 - p) / (q - p)) * gamma((q - 1) / (q - p)) / (a * (q - p)) * (a / b) ** ((1 - p) / (q - p))
        assert two_power_time(a, p, b, q) == pytest.approx(whole, rel=1e-12)
        assert two_power_time(a, p, b, q, low) + two_power_time(a, p, b, q, np.inf, low) == pytest.approx(whole)


def test_bounded_time_is_a_tight_upper_bound() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        a, p, b, q = random_powers(rng)
        low, high = np.sort(np.exp(rng.uniform(-4, 4, 2)))
        exact = two_power_time(a, p, b, q, high, low)
        upper = passage_time_bound(lambda x, a=a, p=p, b=b, q=q: a * x**p + b * x**q, high, low)
        assert exact <= upper * (1 + 1e-12) and upper <= 1.01 * exact


def test_supremum_is_attained_within_one_percent_and_below_the_printed_bound() -> None:
    rng = np.random.default_rng(3)
    for _ in range(4):
        k1, k2 = np.exp(rng.uniform(-2, 1, 2))
        p, q, delta = rng.uniform(0.2, 0.9), rng.uniform(1.1, 2.0), rng.uniform(0.01, 1.0)
        pull = BatchedFunction(SmoothFixedTime(k1=k1, k2=k2, p=p, q=q, delta=delta).pull_and_slope)

        def rate(_: float, y: Any, pull: BatchedFunction = pull) -> Any:
            return -pull([np.exp(y)])[0][0] / np.exp(y)

        arrived = lambda _, y, delta=delta: y[0] - np.log(delta)  # noqa: E731
        arrived.terminal = True  # type: ignore[attr-defined]
        far = np.log(1e-3 * min(1.0, k2 * (q - 1))) / (1 - q) + 10.0
        time = solve_ivp(rate, (0.0, 1e6), [far], method="LSODA", rtol=1e-8, atol=1e-10, events=arrived).t_events[0][0]
        supremum = two_power_time(k1, p, k2, q, lower=delta)
        assert 0.99 * supremum < time <= supremum * (1 + 1e-6)
        printed = 2 ** ((1 - p) / 2) / (k1 * (1 - p)) + 2 ** ((1 - q) / 2) / (k2 * (q - 1))
        assert supremum < printed


def settled(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """The time when each joint was last outside its core, and the end time."""
    run = scenario.simulate()
    assert run.outcome.ok, run.outcome.message
    law = PrintedLaw.of(scenario)
    assert law is not None and law.powers is not None and run.log is not None
    t, e = np.asarray(run.log.t), np.asarray(run.log.e)
    sides = law.places(np.stack([law.powers.delta, -law.powers.delta]))
    radius = law.radius(t)
    outside = (e > sides[0] * radius) | (e < sides[1] * radius)
    return np.array([t[item].max() if item.any() else 0.0 for item in outside.T]), t[-1]


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in (0, *range(2, 120)))])
def test_run_settles_within_the_bound_for_its_start(seed: int) -> None:
    scenario = constant(seed)
    verdict = settling_time(scenario)
    assert verdict.holds, verdict.assumptions
    bound = verdict.bound
    time, end = settled(scenario)
    assert np.all(time <= np.minimum(bound["given_start"], end))
    assert np.all(bound["given_start"] <= bound["supremum"]) and np.all(bound["supremum"] <= bound["printed"])
    assert verdict.margin is not None and 0 < verdict.margin < 1


def test_examples_of_the_paper_violate_assumptions_of_its_bounds() -> None:
    verdict = settling_time(load("example-4.1"))
    assert verdict.holds is False
    assert verdict.bound["printed"][0] == pytest.approx(429.86, abs=0.01)
    failing = [item.text for item in verdict.assumptions if item.status == "fails"]
    assert len(failing) == 2 and "s0 = 0.05" in failing[0] and "M0" in failing[1]
    assert not verdict.remedies


def test_sampled_data_law_reports_the_deadline_of_its_envelope() -> None:
    verdict = settling_time(load("example-4.1-1khz"))
    assert verdict.holds is None and verdict.bound["deadline"].tolist() == [5.0, 6.0]
