"""Sobol indices: those of functions for which they are known, and SciPy's."""

import numpy as np
import pytest
from scipy import stats

from slidax.core.errors import DefinitionError
from slidax.studies.sensitivity import points_for_indices, sobol_indices

pytest.importorskip("SALib")


def ishigami(x):
    """Its indices are known: T. Ishigami, T. Homma, 1990, with a = 7, b = 0.1."""
    a, b, c = np.pi * (2.0 * x.T - 1.0)
    return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


def found(function, dimension, base=1024, **how):
    alone = [1] * dimension
    return sobol_indices(function(points_for_indices(alone, base, seed=0)), alone, **how)


def test_known_indices_are_found_within_their_intervals():
    ours = found(ishigami, 3, confidence=0.999)
    for share, half, known in (
        (ours.first, ours.first_half, [0.3139, 0.4424, 0.0]),
        (ours.total, ours.total_half, [0.5576, 0.4424, 0.2437]),
    ):
        np.testing.assert_allclose(share, known, atol=0.05)
        assert np.all(np.abs(share - known) <= half + 0.01)


def test_they_are_scipy_s():
    theirs = stats.sobol_indices(
        func=lambda x: ishigami(x.T)[None], n=4096, dists=[stats.uniform()] * 3, rng=np.random.default_rng(0)
    )
    ours = found(ishigami, 3, base=4096)
    np.testing.assert_allclose(ours.first, theirs.first_order, atol=0.03)
    np.testing.assert_allclose(ours.total, theirs.total_order, atol=0.03)


def test_numbers_that_belong_together_have_one_share():
    groups = [2, 1]
    points = points_for_indices(groups, 1024, seed=0)
    assert points.shape == (1024 * 4, 3)
    ours = sobol_indices(points[:, 0] + points[:, 1] + points[:, 2], groups)
    np.testing.assert_allclose(ours.first, [2 / 3, 1 / 3], atol=0.05)


def test_what_does_nothing_has_no_share_and_a_constant_none_at_all():
    ours = found(lambda x: 2.0 * x[:, 0], 3)
    np.testing.assert_allclose(ours.total, [1.0, 0.0, 0.0], atol=0.02)
    nothing = found(lambda x: np.ones(len(x)), 2)
    assert nothing.variance == 0.0 and nothing.total.tolist() == [0.0, 0.0]


def test_the_same_seed_gives_the_same_intervals_whatever_numpy_s_state_is():
    np.random.seed(0)  # noqa: NPY002
    item = found(ishigami, 3, seed=0)
    np.random.seed(5)  # noqa: NPY002
    np.testing.assert_array_equal(item.total_half, found(ishigami, 3, seed=0).total_half)


def test_more_confidence_is_a_wider_interval():
    assert np.all(found(ishigami, 3, confidence=0.99).total_half > found(ishigami, 3, confidence=0.8).total_half)


def test_what_cannot_be_is_refused():
    with pytest.raises(DefinitionError, match="power of two"):
        points_for_indices([1, 1], 100)
    with pytest.raises(DefinitionError, match="1 of 40 results are not finite"):
        sobol_indices(np.where(np.arange(40) == 3, np.inf, 1.0), [1, 1])
    with pytest.raises(DefinitionError, match="all points"):
        sobol_indices(np.ones(41), [1, 1])
