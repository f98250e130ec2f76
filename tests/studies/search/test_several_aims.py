"""Fronts: what is on them, that they are found, and that a condition is kept."""

import numpy as np
import pytest

from slidax.core.errors import DefinitionError
from slidax.studies.pareto import FrontEvaluation, non_dominated, pareto_search, thin_front

pytest.importorskip("cmaes")


def two_bowls(x):
    """Best between 0.2 and 0.8 in the first number, at 0.5 in the others: there one falls only if the other grows."""
    rest = np.sum((x[:, 1:] - 0.5) ** 2, axis=1)
    return np.stack([(x[:, 0] - 0.2) ** 2 + rest, (x[:, 0] - 0.8) ** 2 + rest], axis=1) + 0.01


def free(x):
    return FrontEvaluation(two_bowls(x), np.full(len(x), -1.0))


def conditional(x):
    return FrontEvaluation(two_bowls(x), 0.5 - x[:, 0])


def test_dominated_rows_are_left_out():
    aims = np.array([[1.0, 4.0], [2.0, 3.0], [2.0, 3.0], [3.0, 3.5], [4.0, 1.0], [1.0, 5.0]])
    assert non_dominated(aims).tolist() == [True, True, False, False, True, False]
    rng = np.random.default_rng(0)
    many = rng.random((300, 3))
    plainly = [not np.any(np.all(many <= row, axis=1) & np.any(many < row, axis=1)) for row in many]
    assert non_dominated(many).tolist() == plainly


def test_a_thin_front_keeps_its_ends_and_spreads():
    aims = np.stack([np.linspace(0, 1, 101), np.linspace(1, 0, 101) ** 2], axis=1)
    chosen = thin_front(aims, 5)
    assert len(chosen) == 5 and {0, 100} <= set(chosen.tolist())
    assert np.diff(chosen).min() > 10


def test_the_front_is_found_from_end_to_end():
    front = pareto_search(free, 4, evaluations=2000)
    np.testing.assert_allclose(front.points[:, 1:], 0.5, atol=0.1)
    assert front.points[:, 0].min() < 0.25 and front.points[:, 0].max() > 0.75
    # Where both are known: √(f1 - 0.01) + √(f2 - 0.01) = 0.6 on the front.
    np.testing.assert_allclose(np.sqrt(front.aims - 0.01).sum(axis=1), 0.6, atol=0.05)
    assert np.all(np.diff(front.aims[:, 0]) >= 0.0) and non_dominated(front.aims).all()


def test_what_breaks_the_condition_is_not_on_the_front():
    front = pareto_search(conditional, 4, evaluations=2000, start=np.array([0.1, 0.5, 0.5, 0.5]))
    assert front.start is None
    assert front.points[:, 0].min() == pytest.approx(0.5, abs=0.02)
    assert 0 < front.holding < front.evaluations == 2000


def test_where_nothing_holds_the_front_is_empty():
    front = pareto_search(lambda x: FrontEvaluation(two_bowls(x), 1.0 + x[:, 0]), 2, evaluations=200)
    assert front.points.shape == (0, 2) and front.holding == 0 and front.start is None


def test_the_start_is_judged_first_and_never_beaten_by_what_is_worse():
    begin = np.array([0.5, 0.9, 0.5, 0.5])
    front = pareto_search(free, 4, evaluations=600, start=begin)
    np.testing.assert_allclose(front.start, two_bowls(begin[None])[0])
    assert np.any(np.all(front.aims < front.start, axis=1))


def test_the_same_seed_gives_the_same_front():
    item, same, other = (pareto_search(free, 3, evaluations=300, seed=seed).points for seed in (1, 1, 2))
    np.testing.assert_array_equal(item, same)
    assert item.shape != other.shape or np.any(item != other)


def test_points_without_a_number_are_refused_by_the_search_not_by_an_error():
    def gaps(x):
        return FrontEvaluation(np.where(x[:, :1] < 0.3, np.nan, two_bowls(x)), np.full(len(x), -1.0))

    assert pareto_search(gaps, 2, evaluations=300).points[:, 0].min() >= 0.3


def test_three_aims_and_one_aim_go_as_well():
    three = pareto_search(
        lambda x: FrontEvaluation(np.concatenate([two_bowls(x), x[:, 1:2] + 0.1], 1), -x[:, 0]), 3, evaluations=600
    )
    assert three.aims.shape[1] == 3 and len(three.aims) > 3
    item = pareto_search(lambda x: FrontEvaluation(two_bowls(x)[:, :1], -np.ones(len(x))), 3, evaluations=600)
    assert len(item.points) == 1 and item.points[0, 0] == pytest.approx(0.2, abs=0.05)


def test_a_start_outside_is_refused():
    with pytest.raises(DefinitionError, match="point of the unit cube"):
        pareto_search(free, 3, evaluations=10, start=np.array([0.5, 2.0, 0.5]))
