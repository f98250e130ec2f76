"""Searches find what is there to be found, within their budget, and the same again with the same seed."""

import sys

import numpy as np
import pytest
from scipy.optimize import rosen

from slidax.core.errors import DefinitionError
from slidax.studies import search as island_file
from slidax.studies.search import distinct_minima, search_lowest, spread_points

pytest.importorskip("cmaes")


def bowl(x):
    """Smooth, with its bottom, 0, inside."""
    return np.sum((x - 0.3) ** 2, axis=1)


def narrow(x):
    """A slope that leads to a small hole in a corner: its volume is 1e-6 of the cube."""
    near = np.linalg.norm(x - 0.95, axis=1)
    return near - np.where(np.max(np.abs(x - 0.95), axis=1) < 0.05, 2.0, 0.0)


def two_holes(x):
    return np.minimum(np.sum((x - 0.15) ** 2, axis=1), np.sum((x - 0.85) ** 2, axis=1) + 0.01)


def test_the_bottom_of_a_smooth_function_is_found_to_many_digits():
    result = search_lowest(bowl, 4, evaluations=2500)
    np.testing.assert_allclose(result.points[0], 0.3, atol=1e-4)
    assert result.values[0] < 1e-8
    assert result.evaluations <= 2500


def test_a_bent_valley_is_followed_to_its_end():
    result = search_lowest(lambda x: rosen(4.0 * x.T - 2.0), 4, evaluations=12_000)
    np.testing.assert_allclose(result.points[0], 0.75, atol=2e-3)


def test_a_hole_that_ten_thousand_random_points_miss_is_found():
    rng = np.random.default_rng(0)
    assert narrow(rng.random((10_000, 6))).min() > 0.0
    result = search_lowest(narrow, 6, evaluations=3000, enough=0.0)
    assert result.stop == "enough" and result.values[0] < 0.0 and result.evaluations < 3000


def test_what_is_lowest_on_a_face_or_a_corner_is_found_there():
    result = search_lowest(lambda x: -x[:, 0] + (x[:, 1] - 0.4) ** 2, 2, evaluations=1500)
    np.testing.assert_allclose(result.points[0], [1.0, 0.4], atol=1e-3)


def test_several_low_places_are_kept_apart():
    result = search_lowest(two_holes, 3, evaluations=4000, keep=2, distance=0.3)
    np.testing.assert_allclose(result.points, [[0.15] * 3, [0.85] * 3], atol=0.01)
    np.testing.assert_allclose(result.values, [0.0, 0.01], atol=1e-3)


def test_the_same_seed_asks_for_the_same_points():
    item, same, other = (search_lowest(bowl, 3, evaluations=700, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(item.points, same.points)
    np.testing.assert_array_equal(item.history, same.history)
    assert item.points[0].tolist() != other.points[0].tolist()


def test_no_point_outside_and_none_beyond_the_budget_is_asked_for():
    request = []

    def watched(x):
        request.append(len(x))
        assert x.min() >= 0.0 and x.max() <= 1.0
        return x[:, 0]

    for budget in (1, 50, 777):
        request.clear()
        assert search_lowest(watched, 2, evaluations=budget).evaluations == sum(request) <= budget


def test_time_ends_it():
    assert search_lowest(bowl, 3, evaluations=10**9, seconds=0.3).stop == "seconds"


def test_points_without_a_number_are_as_high_as_can_be():
    result = search_lowest(lambda x: np.where(x[:, 0] < 0.5, np.nan, x[:, 0]), 2, evaluations=800)
    assert result.values[0] == pytest.approx(0.5, abs=1e-2)
    assert np.isfinite(result.values).all()
    assert search_lowest(lambda x: np.full(len(x), np.nan), 2, evaluations=300).values.size == 0


def test_the_quasi_newton_steps_help_where_the_function_is_smooth(monkeypatch):
    with_steps = search_lowest(bowl, 8, evaluations=1200, seed=3).values[0]
    monkeypatch.setattr(sys.modules[search_lowest.__module__], "refine", lambda points, start: None)
    assert with_steps < 1e-2 * search_lowest(bowl, 8, evaluations=1200, seed=3).values[0]


def test_what_cannot_be_searched_is_refused(monkeypatch):
    with pytest.raises(DefinitionError, match="at least one number"):
        search_lowest(bowl, 0, evaluations=10)
    with pytest.raises(DefinitionError, match="at least one evaluation"):
        search_lowest(bowl, 2, evaluations=0)
    with pytest.raises(DefinitionError, match="one number for each point"):
        search_lowest(lambda x: x, 2, evaluations=10)
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(DefinitionError, match=r"slidax\[studies\]"):
        island_file.require_cmaes()


def test_first_points_are_the_middle_corners_and_an_even_spread():
    few = spread_points(2, 64, seed=0)
    assert few.shape == (64, 2) and few[0].tolist() == [0.5, 0.5]
    assert {tuple(x) for x in few[1:5].tolist()} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    counts, *_ = np.histogram2d(*few[5:].T, bins=4)
    assert counts.min() >= 2
    assert spread_points(12, 100, seed=1).shape == (100, 12)


def test_the_lowest_of_each_neighbourhood_is_chosen():
    points, values = np.array([[0.0], [0.1], [0.5], [0.55], [1.0]]), np.array([3.0, 1.0, 2.0, 1.5, 9.0])
    assert distinct_minima(points, values, 3, 0.2).tolist() == [1, 3, 4]
    assert distinct_minima(points, values, 2, 0.2).tolist() == [1, 3]
