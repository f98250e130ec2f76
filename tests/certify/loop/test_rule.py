"""The worst-case recursion is exact, and a bound uses the first initial set that holds."""

import sys
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify.loop.envelope import SampledEnvelope, map_rows, pad_rows, solve_plan, worst_case_reach
from slidax.certify.loop.fixed_point import fixed_point
from slidax.law import FixedTime, Linear, PrescribedPerformance, Sides, SmoothFixedTime
from slidax.law.error_transformations import psi

OVERSHOOT = 0.3
SURFACE = SmoothFixedTime(0.5, 1.0, 0.5, 1.2, 0.01)


def narrowing(h, horizon, start, final, deadline, samples=300):
    drawn = PrescribedPerformance(FixedTime(start, final, deadline, 2.01), OVERSHOOT)
    sides = Sides(jnp.array([-OVERSHOOT]), jnp.array([1.0]))
    return SampledEnvelope.of(drawn, sides, period=h, horizon=horizon, times=np.arange(samples) * h)


def pushed(envelope, surface, w, e, v=0.0):
    """The law's own steps on one joint under disturbances w [N]: e at each sample."""
    h, horizon, c = envelope.period, envelope.horizon, envelope.lead
    sides = Sides(jnp.asarray(envelope.lower), jnp.asarray(envelope.upper))

    @jax.jit
    def place(y, radius):
        both = jnp.stack([jnp.maximum(-y, 0.0), jnp.maximum(y, 0.0)])[:, None]
        share = solve_plan(surface, sides, radius, jnp.asarray(horizon), both, jnp.zeros((2, 1)))[1]
        return (share[1] - share[0])[0]

    errors = [e]
    for k in range(envelope.times.size - 1):
        y = e + c * v
        a = ((envelope.ahead[k, 0] * float(place(jnp.asarray(y), envelope.now[k])) - y) / horizon - v) / horizon + w[k]
        e, v = e + h * v + 0.5 * h * h * a, v + h * a
        errors.append(e)
    return np.array(errors)


@pytest.fixture(scope="module")
def fast():
    """A long horizon with a fast narrowing: the closed form allows this disturbance, but the envelope is left."""
    return narrowing(4e-3, 52e-3, 1.1, 6e-4, 0.5)


def test_recursion_predicts_the_exit_for_a_long_horizon_and_fast_narrowing(fast):
    w = 0.98 * OVERSHOOT * 6e-4 / fast.horizon**2
    start = (np.array([0.5]), np.array([0.5]))
    bound = worst_case_reach(fast, SURFACE, w, start)
    e = pushed(fast, SURFACE, np.full(300, w), 0.5)
    assert not bound.holds[0] and fast.unruly[0]
    widths = np.max(e / fast.radius[:, 0])
    assert 2.5 < widths < 2.7
    np.testing.assert_allclose(np.max(bound.error[1, :, 0] / fast.radius[:, 0]), widths, rtol=1e-6)


def test_constant_outward_disturbance_attains_the_bound(fast):
    gentle = narrowing(2e-3, 6e-3, 1.0, 1e-2, 0.4)
    for envelope in (fast, gentle):
        for surface in (SURFACE, Linear(2.0)):
            w = 0.5 * OVERSHOOT * envelope.radius[-1, 0] / envelope.horizon**2
            bound = worst_case_reach(envelope, surface, w, (np.array([0.1]), np.array([0.1])))
            e = pushed(envelope, surface, np.full(300, w), 0.1)
            np.testing.assert_allclose(e, bound.error[1, :, 0], rtol=1e-6)


def test_random_disturbances_stay_within_the_bound(fast):
    rng = np.random.default_rng(5)
    w = 0.5 * OVERSHOOT * 6e-4 / fast.horizon**2
    bound = worst_case_reach(fast, SURFACE, w, (np.array([0.3]), np.array([0.3])))
    for _ in range(5):
        e = pushed(fast, SURFACE, rng.choice([-w, w], 300), 0.3)
        assert np.all(e <= bound.error[1, :, 0] * (1 + 1e-9))
        assert np.all(-e <= bound.error[0, :, 0] * (1 + 1e-9) + 1e-15)


def test_closed_form_equals_the_recursion_where_its_premises_hold():
    envelope = narrowing(1e-3, 3e-3, 0.5, 5e-3, 0.25)
    assert not np.any(envelope.slim[:240])
    # H² w̄ = (ϑ - ψ(ε̄)) ρ∞ with φ(ε̄) = H w̄, by halving.
    eps = np.geomspace(1e-6, 10.0, 20000)
    phi = np.asarray(SURFACE.phi_and_slope(jnp.asarray(eps))[0])
    place = np.asarray(psi(jnp.asarray(eps), Sides(jnp.array([-1.0]), jnp.array([OVERSHOOT]))))
    limit = float(phi[np.argmin(np.abs(envelope.horizon * phi - (OVERSHOOT - place) * 5e-3))]) / envelope.horizon
    start = (np.array([0.1]), np.array([0.1]))
    assert worst_case_reach(envelope, SURFACE, 0.99 * limit, start).holds[0]
    assert not worst_case_reach(envelope, SURFACE, 1.01 * limit, start).holds[0]


proved = sys.modules["slidax.certify.loop.set_bound"]


@pytest.fixture
def begun(monkeypatch):
    """The beginning that is used if some hold, and all that were tried with their limit."""

    def of(*holding):
        tried = []

        def bounded(subject, entry, ideal, demand, chance, *, enough, fineness):
            tried.append((entry, enough))
            return SimpleNamespace(entry=entry, holds=entry in holding, assembly=SimpleNamespace(stable=True))

        approach = SimpleNamespace(late=0, samples=200, entry=Sample)
        monkeypatch.setattr(proved, "simulate_cases", lambda _: approach)
        monkeypatch.setattr(proved, "_narrow", lambda *_: 100)
        monkeypatch.setattr(proved, "planned_run", lambda *_: SimpleNamespace(motion=None))
        monkeypatch.setattr(proved, "compute_demand", lambda *_, **__: None)
        monkeypatch.setattr(proved, "_bounded", bounded)
        subject = SimpleNamespace(law=SimpleNamespace(joints=2), scenario=None)
        return proved.set_bound(subject).entry, tried

    return of


class Sample(int):
    """The number of an initial set without learned models."""

    arms = ()

    def __new__(cls, sample, beside):
        return super().__new__(cls, sample)


def test_first_beginning_that_holds_is_used(begun):
    assert begun(0, 30, 60, 100) == (0, [(0, 1.0)])
    # One may hold where a later one does not: its error has died out when the envelope is narrow.
    assert begun(60) == (60, [(0, 1.0), (30, 1.0), (60, 1.0)])


def test_latest_bound_is_complete_if_none_holds(begun):
    assert begun() == (100, [(0, 1.0), (30, 1.0), (60, 1.0), (100, np.inf)])


class Growing:
    """Bounds that grow each round with their demand."""

    demand = SimpleNamespace(
        disturbance=np.zeros((1, 4, 2)), deviation=lambda *_: np.ones((4, 2)), prediction_error=lambda *_: 0.0
    )
    subject = SimpleNamespace(law=SimpleNamespace(delay=1.0))
    confirmed = False
    share = 0.5

    def certified(self, more, misread):
        self.share *= 2.0
        return SimpleNamespace(share=np.array([self.share]))

    def reach(self, bounds):
        return np.zeros((4, 2)), np.zeros((2, 4, 2)), 0.0, 0.0


def test_fixed_point_iteration_stops_at_the_given_share():
    soon, late = Growing(), Growing()
    assert fixed_point(soon, 1.0) is None and fixed_point(late) is None and soon.share < late.share


def test_rows_of_any_number_share_one_compiled_program():
    traced = []

    @eqx.filter_jit
    def square(by, rows):
        traced.append(rows.shape)
        return {"x": by * jnp.square(rows)}

    values = np.arange(5.0)
    few, many = map_rows(square, values[:3], 8, 2.0), map_rows(square, values, 8, 2.0)
    assert traced == [(8,)] and np.array_equal(few["x"], 2.0 * values[:3] ** 2)
    assert np.array_equal(many["x"], 2.0 * values**2) and np.array_equal(pad_rows(values, 2), values)
