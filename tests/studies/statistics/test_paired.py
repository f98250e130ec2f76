"""Two schemes on the same cases: differences with intervals that hold as often as they say."""

import numpy as np
import pytest
from scipy import stats

from slidax.core.errors import DefinitionError
from slidax.studies.statistics import paired_difference, paired_shares


def pairs(n, seed, shift=0.3):
    rng = np.random.default_rng(seed)
    case = rng.exponential(size=n)
    return case + shift + 0.5 * rng.normal(size=n), case


def test_what_the_cases_have_in_common_does_not_blur_the_difference():
    item, other = pairs(200, 0)
    result = paired_difference(item, other)
    assert result.significant and 0.3 in result.of_mean and 0.3 in result.of_median
    assert result.of_mean.upper - result.of_mean.lower < 0.2
    np.testing.assert_allclose([result.mean, result.median], [np.mean(item - other), np.median(item - other)])
    np.testing.assert_allclose(result.p_value, stats.wilcoxon(item, other).pvalue)


def test_the_interval_of_the_mean_is_near_student_s_where_all_is_normal():
    item, other = pairs(400, 1)
    result, t = paired_difference(item, other).of_mean, stats.ttest_rel(item, other).confidence_interval()
    np.testing.assert_allclose([result.lower, result.upper], [t.low, t.high], atol=0.01)


def test_the_same_seed_gives_the_same_interval():
    item, other = pairs(50, 2)
    assert paired_difference(item, other, seed=3) == paired_difference(item, other, seed=3)
    assert paired_difference(item, other, seed=3).of_mean != paired_difference(item, other, seed=4).of_mean


def test_cases_without_a_number_are_left_out():
    item, other = pairs(30, 3)
    gaps = np.where(np.arange(30) % 7 == 0, np.nan, item)
    result = paired_difference(gaps, other)
    assert result.pairs == 25
    assert result.mean == pytest.approx(np.nanmean(gaps - other))
    assert paired_difference([np.inf], [1.0]).mean is None


def test_few_or_equal_cases_say_what_they_can():
    assert paired_difference([2.0], [1.0]).of_mean is None
    same = paired_difference(np.ones(20), np.ones(20))
    assert (same.mean, same.of_mean.lower, same.of_mean.upper, same.p_value) == (0.0, 0.0, 0.0, 1.0)
    assert not same.significant
    assert paired_difference([1.0, 2.0], [0.0, 0.5]).of_median is None


@pytest.mark.parametrize("paired", [paired_difference, paired_shares])
def test_different_cases_are_refused(paired):
    with pytest.raises(DefinitionError, match="for each case"):
        paired([1.0, 0.0], [1.0])


def test_shares_are_compared_where_they_differ():
    item = np.array([True] * 30 + [False] * 70)
    other = np.array([True] * 20 + [False] * 75 + [True] * 5)
    result = paired_shares(item, other)
    assert (result.only_one, result.only_other) == (10, 5)
    assert result.difference == pytest.approx(0.05)
    assert result.difference in result.interval and 0.0 in result.interval
    # 2 Pr(X <= 5), X of 15 fair coins.
    assert result.p_value == pytest.approx(2 * sum(stats.binom.pmf(range(6), 15, 0.5)))


def test_shares_that_never_differ():
    result = paired_shares(np.ones(40, bool), np.ones(40, bool))
    assert result.p_value == 1.0 and result.interval.lower < 0.0 < result.interval.upper < 0.1
    assert paired_shares([], []).interval is None


def covered_shares(repeats):
    rng, truth = np.random.default_rng(0), 0.12 - 0.05
    inside = 0
    for kinds in rng.choice(3, size=(repeats, 150), p=[0.12, 0.05, 0.83]):
        inside += truth in paired_shares(kinds == 0, kinds == 1).interval
    return inside / repeats


def covered_means(repeats):
    inside = 0
    for seed in range(repeats):
        inside += 0.3 in paired_difference(*pairs(40, seed), 0.9, seed=seed).of_mean
    return inside / repeats


def test_intervals_hold_as_often_as_they_say():
    assert covered_shares(1000) == pytest.approx(0.95, abs=0.025)
    assert covered_means(30) >= 0.75


@pytest.mark.full
def test_intervals_hold_as_often_as_they_say_in_many_studies():
    assert covered_shares(10_000) == pytest.approx(0.95, abs=0.012)
    assert covered_means(2000) == pytest.approx(0.9, abs=0.03)
