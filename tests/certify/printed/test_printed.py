"""Settling time, final error and period limit of the printed law, compared with quadrature and runs."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import gamma

from slidax.certify.printed import printed_period, settling_time, two_power_time, ultimate_bound
from slidax.certify.printed.printed_law import PrintedLaw
from slidax.certify.printed.settling_time import passage_time_bound
from slidax.certify.sampled_scenario import BatchedFunction
from slidax.law import SmoothFixedTime
from slidax.scenarios import Scenario, load

INERTIA = 6.0


def constant(seed: int, **changes: Any) -> Scenario:
    """A law that meets all assumptions: M0 = M = 6 I, the unit vector, continuous time, a bounded disturbance."""
    rng = np.random.default_rng(seed)

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    radius = uniform(0.3, 1.5)
    sign = rng.choice([-1.0, 1.0], 2)
    error = sign * radius * rng.uniform(1e-3, 0.95, 2)
    arm = {"lengths": [1.0, 1e-13], "masses": [0.5, 0.5], "inertias": [INERTIA - 1.0, INERTIA]}
    changes_of_seed = {
        "robot": {"kind": "two_link", "plant": arm, "nominal": {}},
        "trajectory": {"kind": "sinusoid", "offset": [0.0, 0.5], "amplitude": [0.3, 0.2], "frequency": [1.0, 1.5]},
        "disturbance.terms": [{"kind": "harmonic", "amplitude": rng.uniform(0, 3, 2).tolist(), "frequency": 3.0}],
        "start.q": [float(error[0]), float(0.5 + error[1])],
        "start.dq": rng.uniform(-0.5, 0.5, 2).tolist(),
        "scheme.performance": {
            "kind": "fixed_time",
            "initial": radius,
            "final": radius * uniform(0.02, 0.2),
            "deadline": uniform(0.5, 2.0),
            "exponent": uniform(2.01, 3.0),
        },
        "scheme.overshoot": uniform(0.1, 0.9),
        "scheme.surface": {
            "k1": uniform(0.1, 0.6),
            "k2": uniform(0.2, 1.0),
            "p": uniform(0.3, 0.8),
            "q": uniform(1.1, 1.8),
            "delta": uniform(0.05, 0.3),
        },
        "scheme.reaching": {"gain": uniform(0.1, 5.0), "exponent": uniform(1.1, 1.8), "layer": 0.0},
        "scheme.bound": {
            "inverse_inertia_min": 1.0 / INERTIA,
            "inverse_inertia_max": 1.0 / INERTIA,
            "b0": 5.0,
            "b1": 0.0,
            "b2": 0.0,
            "margin": uniform(1.0, 4.0),
        },
        "simulation": {"mode": "continuous", "period": 1e-4, "t1": 12.0, "log_every": 10},
    }
    return load("example-4.1", {**changes_of_seed, **changes})


def random_powers(rng: np.random.Generator) -> tuple[float, float, float, float]:
    a, b = np.exp(rng.uniform(-4, 4, 2))
    return float(a), float(rng.uniform(0.0, 0.95)), float(b), float(rng.uniform(1.05, 3.0))


def integral(a: float, p: float, b: float, q: float, low: float, high: float) -> float:
    """The integral over the logarithm, where the integrand is smooth."""

    def integrand(y: float) -> float:
        return 1.0 / (a * np.exp(y * (p - 1)) + b * np.exp(y * (q - 1)))

    return float(quad(integrand, np.log(low), np.log(high), epsabs=0, limit=200)[0])


def test_two_power_settling_time_formula_equals_its_integral():
    rng = np.random.default_rng(1)
    for _ in range(200):
        a, p, b, q = random_powers(rng)
        low, high = np.sort(np.exp(rng.uniform(-9, 9, 2)))
        wanted = integral(a, p, b, q, low, high)
        assert two_power_time(a, p, b, q, high, low) == pytest.approx(wanted, rel=1e-7)
        whole = gamma((1 - p) / (q - p)) * gamma((q - 1) / (q - p)) / (a * (q - p)) * (a / b) ** ((1 - p) / (q - p))
        assert two_power_time(a, p, b, q) == pytest.approx(whole, rel=1e-12)
        assert two_power_time(a, p, b, q, low) + two_power_time(a, p, b, q, np.inf, low) == pytest.approx(whole)


def test_passage_time_bound_exceeds_the_exact_time_by_at_most_1_percent():
    rng = np.random.default_rng(2)
    for _ in range(50):
        a, p, b, q = random_powers(rng)
        low, high = np.sort(np.exp(rng.uniform(-4, 4, 2)))
        exact = two_power_time(a, p, b, q, high, low)
        upper = passage_time_bound(lambda x, a=a, p=p, b=b, q=q: a * x**p + b * x**q, high, low)
        assert exact <= upper * (1 + 1e-12) and upper <= 1.01 * exact


def test_settling_time_supremum_is_nearly_attained_and_below_the_printed_bound():
    rng = np.random.default_rng(3)
    for _ in range(4):
        k1, k2 = np.exp(rng.uniform(-2, 1, 2))
        p, q, delta = rng.uniform(0.2, 0.9), rng.uniform(1.1, 2.0), rng.uniform(0.01, 1.0)
        phi = BatchedFunction(SmoothFixedTime(k1=k1, k2=k2, p=p, q=q, delta=delta).phi_and_slope)

        def rate(_: float, y: Any, phi: BatchedFunction = phi) -> Any:
            return -phi([np.exp(y)])[0][0] / np.exp(y)

        arrived = lambda _, y, delta=delta: y[0] - np.log(delta)  # noqa: E731
        arrived.terminal = True  # type: ignore[attr-defined]
        far = np.log(1e-3 * min(1.0, k2 * (q - 1))) / (1 - q) + 10.0
        time = solve_ivp(rate, (0.0, 1e6), [far], method="LSODA", rtol=1e-8, atol=1e-10, events=arrived).t_events[0][0]
        supremum = two_power_time(k1, p, k2, q, lower=delta)
        assert 0.99 * supremum < time <= supremum * (1 + 1e-6)
        printed = 2 ** ((1 - p) / 2) / (k1 * (1 - p)) + 2 ** ((1 - q) / 2) / (k2 * (q - 1))
        assert supremum < printed


def settled(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Return the last time when each joint was outside its core, and the end time."""
    run = scenario.simulate()
    assert run.outcome.ok, run.outcome.message
    law = PrintedLaw.of(scenario)
    assert law is not None and law.powers is not None and run.log is not None
    t, e = np.asarray(run.log.t), np.asarray(run.log.e)
    sides = law.psi(np.stack([law.powers.delta, -law.powers.delta]))
    radius = law.radius(t)
    outside = (e > sides[0] * radius) | (e < sides[1] * radius)
    return np.array([t[item].max() if item.any() else 0.0 for item in outside.T]), t[-1]


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in (0, *range(2, 120)))])
def test_run_settles_within_the_bound_for_its_start(seed):
    scenario = constant(seed)
    verdict = settling_time(scenario)
    assert verdict.holds, verdict.assumptions
    bound = verdict.bound
    time, end = settled(scenario)
    assert np.all(time <= np.minimum(bound["given_start"], end))
    assert np.all(bound["given_start"] <= bound["supremum"]) and np.all(bound["supremum"] <= bound["printed"])
    assert verdict.margin is not None and 0 < verdict.margin < 1


def test_example_4_1_violates_two_assumptions_of_the_printed_settling_time():
    verdict = settling_time(load("example-4.1"))
    assert verdict.holds is False and verdict.bound["printed"][0] == pytest.approx(429.86, abs=0.01)
    failing = [item.text for item in verdict.assumptions if item.status == "fails"]
    assert len(failing) == 2 and "s0 = 0.05" in failing[0] and "M0" in failing[1] and not verdict.remedies


def test_sampled_data_law_reports_the_deadline_of_its_envelope():
    verdict = settling_time(load("example-4.1-1khz"))
    assert verdict.holds is None and verdict.bound["deadline"].tolist() == [5.0, 6.0]


def require_that_the_bound_holds(scenario: Scenario) -> None:
    verdict = ultimate_bound(scenario)
    assert verdict.holds, verdict.assumptions
    run = scenario.simulate()
    assert run.outcome.ok and run.log is not None
    late = np.asarray(run.log.t) > 0.75 * scenario.t1
    error = np.abs(np.asarray(run.log.e))[late].max(axis=0)
    s = np.linalg.norm(np.asarray(run.log.signals["s"])[late], axis=1).max()
    assert np.all(error <= verdict.bound["error"]) and s <= verdict.bound["sliding_variable"]
    # The bound is not too loose: within a factor of 5, as M is constant.
    if scenario.robot == "two_link":
        assert s > 0.2 * verdict.bound["sliding_variable"]


def layered(seed: int) -> Scenario:
    rng = np.random.default_rng(seed)
    term = {"kind": "harmonic", "amplitude": rng.uniform(0.5, 3, 2).tolist(), "frequency": float(rng.uniform(0.5, 5))}
    return constant(seed, **{"scheme.reaching.layer": float(rng.uniform(0.01, 0.1)), "disturbance.terms": [term]})


def scara(seed: int) -> Scenario:
    rng = np.random.default_rng(seed)
    changes: dict[str, Any] = {
        "scheme.reaching.layer": float(rng.uniform(0.005, 0.05)),
        "scheme.bound.margin": float(rng.uniform(1.0, 10.0)),
        "disturbance.scale": float(rng.uniform(0.0, 1.2)),
        "simulation.period": 5e-5,
        "simulation.t1": 12.0,
    }
    return load("example-4.2", changes)


@pytest.mark.full
def test_final_error_of_the_papers_scara_is_below_its_bound():
    require_that_the_bound_holds(load("example-4.2", {"simulation.t1": 9.0}))


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in (0, *range(2, 60)))])
def test_final_error_is_below_its_bound(seed):
    require_that_the_bound_holds(layered(seed) if seed % 3 else scara(seed))


@pytest.mark.full
def test_disturbance_beyond_the_robust_torque_fails_the_final_error_bound_with_a_remedy():
    verdict = ultimate_bound(load("example-4.2", {"disturbance.scale": 8.0}))
    assert verdict.holds is False and "error" not in verdict.bound
    failing = [line for line in verdict.assumptions if line.status == "fails"]
    assert len(failing) == 1 and "u covers" in failing[0].text and failing[0].value > 1.0
    changes = dict(verdict.remedies[0].changes)
    assert ultimate_bound(load("example-4.2", {"disturbance.scale": 8.0, **changes})).holds


def test_wrong_nominal_inertia_fails_the_final_error_bound_with_its_size():
    verdict = ultimate_bound(load("example-4.1"))
    assert verdict.holds is False
    assert [line.value for line in verdict.assumptions if line.status == "fails"] == [pytest.approx(0.2)]


def chatter(period: float) -> float:
    whole = 7.5 / round(7.5 / period)
    changes = {"simulation.mode": "held", "simulation.period": whole, "simulation.t1": 7.5}
    run = load("example-4.1", changes).simulate(log_every=1)
    assert run.log is not None
    tau = np.asarray(run.log.tau)
    return float(np.abs(np.diff(tau[-len(tau) // 10 :], axis=0)).max())


@pytest.mark.parametrize("seed", [0, 1])
def test_sampled_double_integrator_is_stable_exactly_below_the_limit_of_the_printed_period(seed):
    scenario = constant(seed, **{"scheme.reaching.layer": 0.05})
    limit = printed_period(scenario).bound["limit"]
    # Near e = 0 the law is a = -(Λ + b) ė - Λ b e with Λ = φ'(0) β, eqs. (30) and (26), and b = u/(s0 M).
    scheme = scenario.controller
    surface, ends = scheme.surface, scheme.transformation
    l1 = (surface.p**2 / 2 - 5 * surface.p / 2 + 3) * surface.delta ** (surface.p - 1)
    slope = float(surface.k1 * l1 * (1 / ends.overshoot + 1) / ends.performance.final)
    layer = float(scheme.bound.b0 + scheme.bound.margin) / (0.05 * INERTIA)
    for share in (0.5, 0.999, 1.001, 1.5):
        h = share * limit
        feedback = np.array([[slope * layer, slope + layer]])
        loop = np.array([[1, h], [0, 1]]) - np.array([[h * h / 2], [h]]) @ feedback
        assert (np.abs(np.linalg.eigvals(loop)).max() < 1) == (share < 1.0)


@pytest.mark.full
def test_printed_law_fails_the_period_certificate_at_1_khz_with_valid_remedies():
    verdict = printed_period(load("example-4.1", {"simulation.mode": "held", "simulation.period": 1e-3}))
    assert verdict.holds is False and verdict.bound["limit"] == pytest.approx(1.468e-4, rel=1e-3)
    first, second = (dict(line.changes) for line in verdict.remedies)
    assert printed_period(load("example-4.1", {"simulation.mode": "held", **first})).holds
    assert printed_period(load("example-4.1", {"simulation.mode": "held", **second})).holds is None


@pytest.mark.full
def test_run_chatters_beyond_the_certified_period():
    limit = printed_period(load("example-4.1")).bound["period"]
    calm = chatter(0.5 * limit)
    assert chatter(limit) < 20 * calm < chatter(1.1 * limit)


@pytest.mark.parametrize("changes", [{"actuator.dead_time": 0.002}, {"actuator.time_constant": 0.01}])
def test_a_drive_that_delays_the_torque_fails_an_assumption_of_the_ultimate_bound(changes):
    assert ultimate_bound(load("example-4.2")).holds
    verdict = ultimate_bound(load("example-4.2", changes))
    assert verdict.holds is False
    (path,) = changes
    failing = [line.text for line in verdict.assumptions if line.status == "fails"]
    assert [f"the drives deliver the torque at once; the scenario has `{path}`"] == failing


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"sensor.delay": 3.0}, "`sensor`"),
        ({"actuator.dead_time": 3.0}, "`actuator.dead_time`"),
        ({"actuator.time_constant": 0.01}, "`actuator.time_constant`"),
        ({"transmission": {"elasticity": {"stiffness": 1000.0}}}, "elastic joints"),
    ],
)
def test_printed_period_does_not_apply_to_a_loop_with_delays_or_elastic_joints(changes, named):
    held = {"simulation.mode": "held", "simulation.period": 1.25e-4}
    assert printed_period(load("example-4.1", held)).holds
    verdict = printed_period(load("example-4.1", held | changes))
    assert verdict.holds is None and named in verdict.statement
