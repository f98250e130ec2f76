"""The implicit step of laws and arms of all sizes is found within its turns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.law import FixedTimeReaching, TwoPowerReaching
from slidax.law.reaching_laws import PRECISION

CASES = 4000


def cases(seed, joints):
    """Gains and sizes over five decades, inertias of a condition up to 100, layers of any width and none."""
    random = np.random.default_rng(seed)
    turned = np.linalg.qr(random.normal(size=(CASES, joints, joints)))[0]
    spread = 10.0 ** (random.uniform(-2, 0, (CASES, 1)) * random.uniform(0, 1, (CASES, joints)))
    metric = np.einsum("cij,cj,ckj->cik", turned, spread, turned) * 10.0 ** random.uniform(-1, 4, (CASES, 1, 1))
    return [
        jnp.asarray(one)
        for one in (
            *10.0 ** random.uniform(-2, 3, (2, CASES, joints)),
            1.0 + 10.0 ** random.uniform(-2, 0.5, CASES),
            random.uniform(0.05, 0.99, CASES),
            np.where(random.random(CASES) < 0.5, 0.0, 10.0 ** random.uniform(-6, 0, CASES)),
            0.5 * (metric + metric.transpose(0, 2, 1)),
            random.normal(size=(CASES, joints)) * 10.0 ** random.uniform(-6, 1, (CASES, 1)),
            np.where(random.random(CASES) < 0.2, 0.0, 10.0 ** random.uniform(-3, 3, CASES)),
        )
    ]


def solved(two, joints):
    """For each case what is left of the equation at the s⁺ that is found, and the tolerance."""

    def one(k1, k2, above, below, layer, metric, s, u):
        law = TwoPowerReaching(k1, k2, above, below, layer) if two else FixedTimeReaching(k1, above, layer)
        found = law.implicit(metric, s, u)
        push = metric @ s
        left = jnp.linalg.norm(metric @ found + law.continuous_term_and_slope(found)[0] - push + u * unit(found, layer))
        held = (layer == 0) & (jnp.linalg.norm(push) <= u)
        return jnp.where(held, jnp.linalg.norm(found), left), PRECISION * (1.0 + jnp.linalg.norm(push))

    def unit(s, layer):
        size = jnp.linalg.norm(s)
        return s / jnp.where(size + layer > 0, size + layer, 1.0)

    left, tolerance = jax.jit(jax.vmap(one))(*cases(joints, joints))
    return np.asarray(left), np.asarray(tolerance)


@pytest.mark.parametrize("joints", [2, pytest.param(7, marks=pytest.mark.full)])
def test_a_power_above_one_is_met_within_the_turns(joints):
    left, tolerance = solved(False, joints)
    assert np.all(left <= 2 * tolerance)


@pytest.mark.parametrize("joints", [2, pytest.param(7, marks=pytest.mark.full)])
def test_so_is_one_below_one_but_for_a_few_in_a_thousand(joints):
    """Where s⁺ is next to zero the unit vector and the power both turn within nothing."""
    left, tolerance = solved(True, joints)
    assert np.mean(left <= 2 * tolerance) >= 0.995
