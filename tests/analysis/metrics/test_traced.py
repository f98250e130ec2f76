"""Metrics inside `grad`, `jit` and `vmap`: derivatives where there are some, a refusal by name where there are none."""

from __future__ import annotations

from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax import analysis
from slidax.analysis import METRICS, Metric
from slidax.analysis.metric import safe_sqrt
from slidax.core.errors import DefinitionError
from slidax.paper.printed import INDICES
from slidax.simulation import Run, simulate, value_and_gradient
from tests.paper_examples import MOTION_4_1, START_4_1
from tests.simulation.simple import SMOOTH_PLANT, BoundedLaw, Spring

HOW: dict[str, Any] = {"t1": 0.2, "period": 2e-3, "log_every": None}
SMOOTH = [one for one in (*METRICS, *INDICES) if not one.counts]
COUNTING = [analysis.envelope_violations, analysis.tolerance_violations, analysis.warned_at]


def define(stiffness: Any) -> Any:
    spring = Spring(stiffness=stiffness * jnp.array([300.0, 200.0]), damping=jnp.array([30.0, 20.0]))
    return SMOOTH_PLANT, BoundedLaw(spring=spring, radius=jnp.array([2.0, 2.0])), MOTION_4_1, START_4_1


def sums(run: Run) -> dict[str, Any]:
    return {one.key: jnp.sum(jnp.asarray(one(run))) for one in SMOOTH}


def test_every_metric_that_does_not_count_has_the_slope_that_differences_show() -> None:
    at, h = jnp.asarray(1.0), 1e-5
    _, slopes = jax.jit(lambda x: jax.jvp(lambda x: sums(simulate(*define(x), **HOW)), (x,), (jnp.ones(()),)))(at)
    high, low = (sums(simulate(*define(at + shift), **HOW)) for shift in (h, -h))
    assert len(slopes) >= 12
    for key, slope in slopes.items():
        assert float(slope) == pytest.approx(float(high[key] - low[key]) / (2 * h), rel=1e-4, abs=1e-9), key
    assert sum(abs(float(slope)) > 1e-6 for slope in slopes.values()) >= 10


@pytest.mark.full
def test_reverse_mode_and_our_own_gradient_agree_on_a_metric() -> None:
    def total(run: Run) -> Any:
        return jnp.sum(jnp.asarray(analysis.rms_error(run)))

    at = jnp.asarray(1.0)
    reverse = jax.grad(lambda x: total(simulate(*define(x), **HOW)))(at)
    how = {name: value for name, value in HOW.items() if name != "log_every"}
    value, ours = value_and_gradient(total, define, at, **how)
    assert float(value) == pytest.approx(float(total(simulate(*define(at), **HOW))), rel=1e-12)
    assert float(ours) == pytest.approx(float(reverse), rel=1e-8)


@cache
def finished() -> Run:
    return simulate(*define(jnp.asarray(1.0)), **HOW)


def traced(one: Any) -> Any:
    """A metric of a run whose tally is not known yet."""
    run = finished()
    return jax.eval_shape(lambda tally: one(eqx.tree_at(lambda run: run.tally, run, tally)), run.tally)


@pytest.mark.parametrize("one", [*COUNTING, lambda run: analysis.settling_time(run, 1e-2)])
def test_a_metric_that_counts_samples_is_refused_by_name(one: Any) -> None:
    name = one.key if isinstance(one, Metric) else "settling_time"
    with pytest.raises(DefinitionError, match=f"`{name}` counts samples, so that it has no derivative"):
        traced(one)


def test_a_metric_of_the_user_that_computes_by_numpy_is_refused_by_name() -> None:
    @analysis.metric("largest error", "{position}")
    def largest(run: Run) -> np.ndarray:
        """`max |e|`."""
        return np.asarray(run.tally.steady_error)

    with pytest.raises(DefinitionError, match=r"`largest` is computed by NumPy.*`slidax\.analysis\.arrays\(run\)`"):
        traced(largest)
    np.testing.assert_array_equal(largest(finished()), analysis.steady_error(finished()))


def test_the_root_of_an_error_of_zero_has_a_slope_of_zero() -> None:
    assert float(jax.grad(lambda x: safe_sqrt(jnp, x * x))(0.0)) == 0.0
    assert float(jax.grad(lambda x: safe_sqrt(jnp, x * x))(-2.0)) == -1.0
