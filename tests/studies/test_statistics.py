"""Intervals of failure rates and of paired differences hold as often as they claim."""

import numpy as np
import pytest
from scipy import stats

from slidax.core.errors import DefinitionError
from slidax.studies.statistics import (
    clopper_pearson,
    confidence_sequence,
    log_evidence,
    paired_difference,
    paired_shares,
)


@pytest.mark.parametrize(("failures", "runs"), [(0, 1), (0, 10000), (3, 100), (50, 100), (9999, 10000), (7, 7)])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_clopper_pearson_agrees_with_scipy(failures, runs, confidence):
    ours = clopper_pearson(failures, runs, confidence)
    theirs = stats.binomtest(failures, runs).proportion_ci(confidence, method="exact")
    np.testing.assert_allclose([ours.lower, ours.upper], [theirs.low, theirs.high], rtol=1e-9, atol=1e-15)


def test_a_one_sided_clopper_pearson_interval_agrees_with_scipy():
    item = clopper_pearson(2, 50, 0.95, side="upper")
    theirs = stats.binomtest(2, 50, alternative="less").proportion_ci(0.95, method="exact")
    assert item.lower == 0.0
    np.testing.assert_allclose(item.upper, theirs.high, rtol=1e-9)


@pytest.mark.parametrize("p", [1e-3, 0.03, 0.5])
@pytest.mark.parametrize("runs", [20, 700])
def test_clopper_pearson_has_its_coverage_at_every_rate(p, runs):
    """The coverage is the exact sum over all possible failure counts, not a simulation."""
    k = np.arange(runs + 1)
    inside = [p in clopper_pearson(int(j), runs, 0.9) for j in k]
    assert stats.binom.pmf(k, runs, p)[inside].sum() >= 0.9


@pytest.mark.parametrize("interval", [clopper_pearson, confidence_sequence])
def test_interval_is_trivial_for_no_runs_and_one_sided_for_equal_outcomes(interval):
    nothing = interval(0, 0)
    assert (nothing.lower, nothing.upper) == (0.0, 1.0)
    assert interval(0, 9).lower == 0.0 < interval(0, 9).upper < 0.5
    assert interval(9, 9).upper == 1.0 > interval(9, 9).lower > 0.5


@pytest.mark.parametrize("interval", [clopper_pearson, confidence_sequence])
@pytest.mark.parametrize(("k", "n", "confidence"), [(-1, 3, 0.9), (4, 3, 0.9), (1, 3, 0.0), (1, 3, 1.0)])
def test_impossible_counts_and_confidences_are_refused(interval, k, n, confidence):
    with pytest.raises(DefinitionError, match="must be in"):
        interval(k, n, confidence)


@pytest.mark.parametrize(("k", "n"), [(0, 1), (0, 5000), (1, 5000), (40, 100), (99, 100), (5, 10**6)])
def test_the_ends_of_a_confidence_sequence_have_the_evidence_of_its_level(k, n):
    result = confidence_sequence(k, n, 0.99)
    for end in {result.lower, result.upper} - {0.0, 1.0}:
        np.testing.assert_allclose(log_evidence(k, n, end), np.log(100.0), rtol=1e-6)
    assert k / n in result


def test_the_confidence_sequence_without_failures_is_as_sharp_as_clopper_pearson():
    for n in (100, 1000, 10000):
        assert confidence_sequence(0, n, 0.99).upper <= clopper_pearson(0, n, 0.99).upper
    assert confidence_sequence(3, 1000, 0.99).upper < 1.55 * clopper_pearson(3, 1000, 0.99).upper


def ever_missed(p, runs, repeats, confidence):
    """Return the share of studies in which the rate was outside the confidence sequence at any time."""
    rng, missed = np.random.default_rng(1), 0
    for _ in range(repeats // 500):
        k = np.cumsum(rng.random((500, runs)) < p, axis=1)
        evidence = log_evidence(k, np.arange(1, runs + 1), p)
        missed += int(np.sum(evidence.max(axis=1) >= -np.log1p(-confidence)))
    return missed / repeats


MANY = [pytest.param(p, 3000, 10_000, marks=pytest.mark.full) for p in (0.001, 0.01, 0.2, 0.5, 0.97)]


@pytest.mark.parametrize(("p", "runs", "repeats"), [(0.02, 1000, 1000), *MANY])
def test_the_confidence_sequence_covers_the_rate_at_all_times_jointly(p, runs, repeats):
    """The misses stay within Ville's bound and are at least a tenth of it, so that the bound is not vacuous."""
    missed = ever_missed(p, runs, repeats, 0.9)
    sure = 4 * np.sqrt(0.1 * 0.9 / repeats)
    assert 0.01 - sure / 4 <= missed <= 0.1 + sure


def test_repeated_evaluation_breaks_the_coverage_of_a_fixed_interval():
    """A fixed interval, evaluated after every 20 runs, misses the rate far more often than its level allows."""
    rng, p = np.random.default_rng(0), 0.1
    ends = {n: [clopper_pearson(k, n, 0.9) for k in range(n + 1)] for n in range(20, 400, 20)}
    k = np.cumsum(rng.random((300, 400)) < p, axis=1)
    missed = np.zeros(300, bool)
    for n, result in ends.items():
        missed |= [p not in result[failures] for failures in k[:, n - 1]]
    assert missed.mean() > 0.15


def pairs(n, seed, shift=0.3):
    rng = np.random.default_rng(seed)
    case = rng.exponential(size=n)
    return case + shift + 0.5 * rng.normal(size=n), case


def test_variation_between_cases_does_not_widen_the_paired_difference():
    item, other = pairs(200, 0)
    result = paired_difference(item, other)
    assert result.significant and 0.3 in result.of_mean and 0.3 in result.of_median
    assert result.of_mean.upper - result.of_mean.lower < 0.2
    np.testing.assert_allclose([result.mean, result.median], [np.mean(item - other), np.median(item - other)])
    np.testing.assert_allclose(result.p_value, stats.wilcoxon(item, other).pvalue)


def test_the_interval_of_the_mean_is_near_students_for_normal_data():
    item, other = pairs(400, 1)
    result, t = paired_difference(item, other).of_mean, stats.ttest_rel(item, other).confidence_interval()
    np.testing.assert_allclose([result.lower, result.upper], [t.low, t.high], atol=0.01)


def test_the_same_seed_gives_the_same_interval():
    item, other = pairs(50, 2)
    assert paired_difference(item, other, seed=3) == paired_difference(item, other, seed=3)
    assert paired_difference(item, other, seed=3).of_mean != paired_difference(item, other, seed=4).of_mean


def test_cases_without_a_finite_value_are_omitted():
    item, other = pairs(30, 3)
    gaps = np.where(np.arange(30) % 7 == 0, np.nan, item)
    result = paired_difference(gaps, other)
    assert result.pairs == 25 and result.mean == pytest.approx(np.nanmean(gaps - other))
    assert paired_difference([np.inf], [1.0]).mean is None


def test_few_or_equal_cases_give_partial_results():
    assert paired_difference([2.0], [1.0]).of_mean is None
    same = paired_difference(np.ones(20), np.ones(20))
    assert (same.mean, same.of_mean.lower, same.of_mean.upper, same.p_value) == (0.0, 0.0, 0.0, 1.0)
    assert not same.significant and paired_difference([1.0, 2.0], [0.0, 0.5]).of_median is None


@pytest.mark.parametrize("paired", [paired_difference, paired_shares])
def test_a_paired_comparison_of_different_cases_is_refused(paired):
    with pytest.raises(DefinitionError, match="per case"):
        paired([1.0, 0.0], [1.0])


def test_paired_shares_are_compared_by_discordant_cases():
    item = np.array([True] * 30 + [False] * 70)
    other = np.array([True] * 20 + [False] * 75 + [True] * 5)
    result = paired_shares(item, other)
    assert (result.only_one, result.only_other) == (10, 5) and result.difference == pytest.approx(0.05)
    assert result.difference in result.interval and 0.0 in result.interval
    # 2 Pr(X <= 5), X of 15 fair coins.
    assert result.p_value == pytest.approx(2 * sum(stats.binom.pmf(range(6), 15, 0.5)))


def test_equal_shares_have_p_value_1():
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


def test_intervals_have_their_stated_coverage():
    assert covered_shares(1000) == pytest.approx(0.95, abs=0.025) and covered_means(30) >= 0.75


@pytest.mark.full
def test_intervals_have_their_stated_coverage_in_many_studies():
    assert covered_shares(10_000) == pytest.approx(0.95, abs=0.012)
    assert covered_means(2000) == pytest.approx(0.9, abs=0.03)
