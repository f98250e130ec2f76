"""Initial sets of a bound: the first one that holds, with as little computation as possible."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify.loop.envelope import map_rows, pad_rows
from slidax.certify.loop.fixed_point import fixed_point

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
    assert fixed_point(soon, 1.0) is None
    assert fixed_point(late) is None
    assert soon.share < late.share


def test_rows_of_any_number_share_one_compiled_program():
    traced = []

    @eqx.filter_jit
    def square(by, rows):
        traced.append(rows.shape)
        return {"x": by * jnp.square(rows)}

    values = np.arange(5.0)
    few, many = map_rows(square, values[:3], 8, 2.0), map_rows(square, values, 8, 2.0)
    assert traced == [(8,)]
    assert np.array_equal(few["x"], 2.0 * values[:3] ** 2)
    assert np.array_equal(many["x"], 2.0 * values**2)
    assert np.array_equal(pad_rows(values, 2), values)
