"""Searches, fronts and Sobol indices of known functions."""

import sys

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import rosen

from slidax.core.errors import DefinitionError
from slidax.studies.pareto import FrontEvaluation, non_dominated, pareto_search, thin_front
from slidax.studies.search import distinct_minima, require_cmaes, search_lowest, spread_points
from slidax.studies.sensitivity import points_for_indices, sobol_indices

pytest.importorskip("cmaes")
pytest.importorskip("SALib")


def bowl(x):
    """A smooth function with its minimum, 0, inside the unit cube."""
    return np.sum((x - 0.3) ** 2, axis=1)


def narrow(x):
    """A slope that leads to a small hole near a corner, with 1e-6 of the cube's volume."""
    near = np.linalg.norm(x - 0.95, axis=1)
    return near - np.where(np.max(np.abs(x - 0.95), axis=1) < 0.05, 2.0, 0.0)


def two_holes(x):
    return np.minimum(np.sum((x - 0.15) ** 2, axis=1), np.sum((x - 0.85) ** 2, axis=1) + 0.01)


def test_the_search_locates_the_minimum_of_a_smooth_function_to_1e_4():
    result = search_lowest(bowl, 4, evaluations=2500)
    np.testing.assert_allclose(result.points[0], 0.3, atol=1e-4)
    assert result.values[0] < 1e-8 and result.evaluations <= 2500


def test_a_curved_valley_is_followed_to_its_minimum():
    result = search_lowest(lambda x: rosen(4.0 * x.T - 2.0), 4, evaluations=12_000)
    np.testing.assert_allclose(result.points[0], 0.75, atol=2e-3)


def test_the_search_reaches_a_narrow_minimum_that_ten_thousand_random_points_miss():
    rng = np.random.default_rng(0)
    assert narrow(rng.random((10_000, 6))).min() > 0.0
    result = search_lowest(narrow, 6, evaluations=3000, enough=0.0)
    assert result.stop == "enough" and result.values[0] < 0.0 and result.evaluations < 3000


def test_the_search_reaches_a_minimum_on_a_face_of_the_unit_cube():
    result = search_lowest(lambda x: -x[:, 0] + (x[:, 1] - 0.4) ** 2, 2, evaluations=1500)
    np.testing.assert_allclose(result.points[0], [1.0, 0.4], atol=1e-3)


def test_several_minima_are_kept_separate():
    result = search_lowest(two_holes, 3, evaluations=4000, keep=2, distance=0.3)
    np.testing.assert_allclose(result.points, [[0.15] * 3, [0.85] * 3], atol=0.01)
    np.testing.assert_allclose(result.values, [0.0, 0.01], atol=1e-3)


def test_the_same_seed_evaluates_the_same_points():
    item, same, other = (search_lowest(bowl, 3, evaluations=700, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(item.points, same.points)
    np.testing.assert_array_equal(item.history, same.history)
    assert item.points[0].tolist() != other.points[0].tolist()


def test_no_point_outside_or_beyond_the_budget_is_evaluated():
    request = []

    def watched(x):
        request.append(len(x))
        assert x.min() >= 0.0 and x.max() <= 1.0
        return x[:, 0]

    for budget in (1, 50, 777):
        request.clear()
        assert search_lowest(watched, 2, evaluations=budget).evaluations == sum(request) <= budget


def test_search_ends_at_its_time_limit():
    assert search_lowest(bowl, 3, evaluations=10**9, seconds=0.3).stop == "seconds"


def test_points_without_a_finite_value_count_as_worst():
    result = search_lowest(lambda x: np.where(x[:, 0] < 0.5, np.nan, x[:, 0]), 2, evaluations=800)
    assert result.values[0] == pytest.approx(0.5, abs=1e-2) and np.isfinite(result.values).all()
    assert search_lowest(lambda x: np.full(len(x), np.nan), 2, evaluations=300).values.size == 0


def test_quasi_newton_steps_improve_the_search_of_a_smooth_function(monkeypatch):
    with_steps = search_lowest(bowl, 8, evaluations=1200, seed=3).values[0]
    monkeypatch.setattr(sys.modules[search_lowest.__module__], "refine", lambda points, start: None)
    assert with_steps < 1e-2 * search_lowest(bowl, 8, evaluations=1200, seed=3).values[0]


def test_an_invalid_search_or_a_missing_cmaes_is_refused(monkeypatch):
    with pytest.raises(DefinitionError, match="at least one uncertain value"):
        search_lowest(bowl, 0, evaluations=10)
    with pytest.raises(DefinitionError, match="at least one evaluation"):
        search_lowest(bowl, 2, evaluations=0)
    with pytest.raises(DefinitionError, match="must return a value for each of"):
        search_lowest(lambda x: x, 2, evaluations=10)
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(DefinitionError, match=r"slidax\[studies\]"):
        require_cmaes()


def test_the_first_search_points_are_the_centre_the_corners_and_an_even_spread():
    few = spread_points(2, 64, seed=0)
    assert few.shape == (64, 2) and few[0].tolist() == [0.5, 0.5]
    assert {tuple(x) for x in few[1:5].tolist()} == {(0, 0), (0, 1), (1, 0), (1, 1)}
    counts, *_ = np.histogram2d(*few[5:].T, bins=4)
    assert counts.min() >= 2 and spread_points(12, 100, seed=1).shape == (100, 12)


def test_distinct_minima_are_the_lowest_points_of_their_neighbourhoods():
    points, values = np.array([[0.0], [0.1], [0.5], [0.55], [1.0]]), np.array([3.0, 1.0, 2.0, 1.5, 9.0])
    assert distinct_minima(points, values, 3, 0.2).tolist() == [1, 3, 4]
    assert distinct_minima(points, values, 2, 0.2).tolist() == [1, 3]


def two_bowls(x):
    """Two aims, Pareto-optimal where the first coordinate is in [0.2, 0.8] and the others are 0.5."""
    rest = np.sum((x[:, 1:] - 0.5) ** 2, axis=1)
    return np.stack([(x[:, 0] - 0.2) ** 2 + rest, (x[:, 0] - 0.8) ** 2 + rest], axis=1) + 0.01


def free(x):
    return FrontEvaluation(two_bowls(x), np.full(len(x), -1.0))


def conditional(x):
    return FrontEvaluation(two_bowls(x), 0.5 - x[:, 0])


def test_non_dominated_marks_exactly_the_pareto_optimal_points():
    aims = np.array([[1.0, 4.0], [2.0, 3.0], [2.0, 3.0], [3.0, 3.5], [4.0, 1.0], [1.0, 5.0]])
    assert non_dominated(aims).tolist() == [True, True, False, False, True, False]
    rng = np.random.default_rng(0)
    many = rng.random((300, 3))
    plainly = [not np.any(np.all(many <= row, axis=1) & np.any(many < row, axis=1)) for row in many]
    assert non_dominated(many).tolist() == plainly


def test_a_thinned_pareto_front_keeps_its_ends_and_a_wide_spacing():
    aims = np.stack([np.linspace(0, 1, 101), np.linspace(1, 0, 101) ** 2], axis=1)
    chosen = thin_front(aims, 5)
    assert len(chosen) == 5 and {0, 100} <= set(chosen.tolist()) and np.diff(chosen).min() > 10


def test_the_pareto_search_covers_the_whole_known_front():
    front = pareto_search(free, 4, evaluations=2000)
    np.testing.assert_allclose(front.points[:, 1:], 0.5, atol=0.1)
    assert front.points[:, 0].min() < 0.25 and front.points[:, 0].max() > 0.75
    # On the exact front, √(f1 - 0.01) + √(f2 - 0.01) = 0.6.
    np.testing.assert_allclose(np.sqrt(front.aims - 0.01).sum(axis=1), 0.6, atol=0.05)
    assert np.all(np.diff(front.aims[:, 0]) >= 0.0) and non_dominated(front.aims).all()


def test_infeasible_points_are_not_on_the_pareto_front():
    front = pareto_search(conditional, 4, evaluations=2000, start=np.array([0.1, 0.5, 0.5, 0.5]))
    assert front.start is None and front.points[:, 0].min() == pytest.approx(0.5, abs=0.02)
    assert 0 < front.holding < front.evaluations == 2000


def test_the_pareto_front_is_empty_without_feasible_points():
    front = pareto_search(lambda x: FrontEvaluation(two_bowls(x), 1.0 + x[:, 0]), 2, evaluations=200)
    assert front.points.shape == (0, 2) and front.holding == 0 and front.start is None


def test_the_pareto_search_evaluates_its_start_and_improves_on_it():
    begin = np.array([0.5, 0.9, 0.5, 0.5])
    front = pareto_search(free, 4, evaluations=600, start=begin)
    np.testing.assert_allclose(front.start, two_bowls(begin[None])[0])
    assert np.any(np.all(front.aims < front.start, axis=1))


def test_the_same_seed_gives_the_same_pareto_front():
    item, same, other = (pareto_search(free, 3, evaluations=300, seed=seed).points for seed in (1, 1, 2))
    np.testing.assert_array_equal(item, same)
    assert not np.array_equal(item, other)


def test_the_pareto_search_rejects_points_without_a_finite_value():
    def gaps(x):
        return FrontEvaluation(np.where(x[:, :1] < 0.3, np.nan, two_bowls(x)), np.full(len(x), -1.0))

    assert pareto_search(gaps, 2, evaluations=300).points[:, 0].min() >= 0.3


def test_the_pareto_search_works_with_one_and_three_objectives():
    three = pareto_search(
        lambda x: FrontEvaluation(np.concatenate([two_bowls(x), x[:, 1:2] + 0.1], 1), -x[:, 0]), 3, evaluations=600
    )
    assert three.aims.shape[1] == 3 and len(three.aims) > 3
    item = pareto_search(lambda x: FrontEvaluation(two_bowls(x)[:, :1], -np.ones(len(x))), 3, evaluations=600)
    assert len(item.points) == 1 and item.points[0, 0] == pytest.approx(0.2, abs=0.05)


def test_a_start_outside_the_unit_cube_is_refused():
    with pytest.raises(DefinitionError, match="point of the unit cube"):
        pareto_search(free, 3, evaluations=10, start=np.array([0.5, 2.0, 0.5]))


def ishigami(x):
    """The Ishigami function (T. Ishigami, T. Homma, 1990) with a = 7, b = 0.1, whose Sobol indices are known."""
    a, b, c = np.pi * (2.0 * x.T - 1.0)
    return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


def indices_of(function, dimension, base=1024, **how):
    alone = [1] * dimension
    return sobol_indices(function(points_for_indices(alone, base, seed=0)), alone, **how)


def test_sobol_indices_of_the_ishigami_function_are_within_their_intervals():
    ours = indices_of(ishigami, 3, confidence=0.999)
    for share, half, known in (
        (ours.first, ours.first_half, [0.3139, 0.4424, 0.0]),
        (ours.total, ours.total_half, [0.5576, 0.4424, 0.2437]),
    ):
        np.testing.assert_allclose(share, known, atol=0.05)
        assert np.all(np.abs(share - known) <= half + 0.01)


def test_sobol_indices_agree_with_scipy():
    theirs = stats.sobol_indices(
        func=lambda x: ishigami(x.T)[None], n=4096, dists=[stats.uniform()] * 3, rng=np.random.default_rng(0)
    )
    ours = indices_of(ishigami, 3, base=4096)
    np.testing.assert_allclose(ours.first, theirs.first_order, atol=0.03)
    np.testing.assert_allclose(ours.total, theirs.total_order, atol=0.03)


def test_grouped_inputs_have_one_sobol_index():
    groups = [2, 1]
    points = points_for_indices(groups, 1024, seed=0)
    assert points.shape == (1024 * 4, 3)
    ours = sobol_indices(points[:, 0] + points[:, 1] + points[:, 2], groups)
    np.testing.assert_allclose(ours.first, [2 / 3, 1 / 3], atol=0.05)


def test_an_idle_input_and_each_input_of_a_constant_function_have_index_zero():
    ours = indices_of(lambda x: 2.0 * x[:, 0], 3)
    np.testing.assert_allclose(ours.total, [1.0, 0.0, 0.0], atol=0.02)
    nothing = indices_of(lambda x: np.ones(len(x)), 2)
    assert nothing.variance == 0.0 and nothing.total.tolist() == [0.0, 0.0]


def test_the_same_seed_gives_the_same_intervals_in_any_state_of_numpys_generator():
    np.random.seed(0)  # noqa: NPY002
    item = indices_of(ishigami, 3, seed=0)
    np.random.seed(5)  # noqa: NPY002
    np.testing.assert_array_equal(item.total_half, indices_of(ishigami, 3, seed=0).total_half)


def test_higher_confidence_gives_a_wider_interval():
    assert np.all(
        indices_of(ishigami, 3, confidence=0.99).total_half > indices_of(ishigami, 3, confidence=0.8).total_half
    )


def test_invalid_sobol_sample_sizes_and_results_are_refused():
    with pytest.raises(DefinitionError, match="power of two"):
        points_for_indices([1, 1], 100)
    with pytest.raises(DefinitionError, match="1 of 40 results are not finite"):
        sobol_indices(np.where(np.arange(40) == 3, np.inf, 1.0), [1, 1])
    with pytest.raises(DefinitionError, match="a value for each point"):
        sobol_indices(np.ones(41), [1, 1])
