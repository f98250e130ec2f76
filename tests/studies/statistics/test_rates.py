"""How often something fails: intervals that hold as often as they say, checked against SciPy and by simulation."""

import numpy as np
import pytest
from scipy import stats

from slidax.core.errors import DefinitionError
from slidax.studies.statistics import clopper_pearson, confidence_sequence, log_evidence, runs_without_failure


@pytest.mark.parametrize(("failures", "runs"), [(0, 1), (0, 10000), (3, 100), (50, 100), (9999, 10000), (7, 7)])
@pytest.mark.parametrize("confidence", [0.9, 0.99])
def test_clopper_pearson_is_scipy_s(failures, runs, confidence):
    ours = clopper_pearson(failures, runs, confidence)
    theirs = stats.binomtest(failures, runs).proportion_ci(confidence, method="exact")
    np.testing.assert_allclose([ours.lower, ours.upper], [theirs.low, theirs.high], rtol=1e-9, atol=1e-15)


def test_one_side_takes_all_of_the_doubt():
    item = clopper_pearson(2, 50, 0.95, side="upper")
    theirs = stats.binomtest(2, 50, alternative="less").proportion_ci(0.95, method="exact")
    assert item.lower == 0.0
    np.testing.assert_allclose(item.upper, theirs.high, rtol=1e-9)


@pytest.mark.parametrize("p", [1e-3, 0.03, 0.5])
@pytest.mark.parametrize("runs", [20, 700])
def test_clopper_pearson_covers_at_every_rate(p, runs):
    """Not by simulation: the probability itself, as the sum over all that can be seen."""
    k = np.arange(runs + 1)
    inside = [p in clopper_pearson(int(j), runs, 0.9) for j in k]
    assert stats.binom.pmf(k, runs, p)[inside].sum() >= 0.9


@pytest.mark.parametrize("interval", [clopper_pearson, confidence_sequence])
def test_of_no_runs_nothing_is_known_and_all_alike_bounds_one_end(interval):
    nothing = interval(0, 0)
    assert (nothing.lower, nothing.upper) == (0.0, 1.0)
    assert interval(0, 9).lower == 0.0 < interval(0, 9).upper < 0.5
    assert interval(9, 9).upper == 1.0 > interval(9, 9).lower > 0.5


@pytest.mark.parametrize("interval", [clopper_pearson, confidence_sequence])
@pytest.mark.parametrize(("k", "n", "confidence"), [(-1, 3, 0.9), (4, 3, 0.9), (1, 3, 0.0), (1, 3, 1.0)])
def test_what_cannot_be_is_refused(interval, k, n, confidence):
    with pytest.raises(DefinitionError, match="must be in"):
        interval(k, n, confidence)


def test_so_many_runs_without_failure_show_the_rate_and_one_less_does_not():
    n = runs_without_failure(1e-3, 0.99)
    assert n == 4603
    assert clopper_pearson(0, n, 0.99, side="upper").upper <= 1e-3 < clopper_pearson(0, n - 1, 0.99, side="upper").upper
    assert runs_without_failure(0.5, 0.75) == 2


@pytest.mark.parametrize(("k", "n"), [(0, 1), (0, 5000), (1, 5000), (40, 100), (99, 100), (5, 10**6)])
def test_the_ends_are_where_the_evidence_is_enough(k, n):
    result = confidence_sequence(k, n, 0.99)
    for end in {result.lower, result.upper} - {0.0, 1.0}:
        np.testing.assert_allclose(log_evidence(k, n, end), np.log(100.0), rtol=1e-6)
    assert k / n in result


def test_without_failure_it_is_as_sharp_as_the_fixed_number_of_runs():
    for n in (100, 1000, 10000):
        assert confidence_sequence(0, n, 0.99).upper <= clopper_pearson(0, n, 0.99).upper
    assert confidence_sequence(3, 1000, 0.99).upper < 1.55 * clopper_pearson(3, 1000, 0.99).upper


def ever_missed(p, runs, repeats, confidence):
    """The share of studies in which the rate was outside at any time."""
    rng, missed = np.random.default_rng(1), 0
    for _ in range(repeats // 500):
        k = np.cumsum(rng.random((500, runs)) < p, axis=1)
        evidence = log_evidence(k, np.arange(1, runs + 1), p)
        missed += int(np.sum(evidence.max(axis=1) >= -np.log1p(-confidence)))
    return missed / repeats


def assert_covers(p, runs, repeats):
    """Ville's bound, and that it is no empty one: a tenth of the misses that it allows do happen."""
    missed = ever_missed(p, runs, repeats, 0.9)
    sure = 4 * np.sqrt(0.1 * 0.9 / repeats)
    assert 0.01 - sure / 4 <= missed <= 0.1 + sure


def test_the_sequence_holds_at_all_times_at_once():
    assert_covers(0.02, 1000, 1000)


@pytest.mark.full
@pytest.mark.parametrize("p", [0.001, 0.01, 0.2, 0.5, 0.97])
def test_the_sequence_holds_at_all_times_at_once_in_ten_thousand_studies(p):
    assert_covers(p, 3000, 10_000)


def test_looking_again_and_again_breaks_the_fixed_interval():
    """Why there is a sequence at all: the fixed one, looked at after each run, misses far more often than it says."""
    rng, p = np.random.default_rng(0), 0.1
    ends = {n: [clopper_pearson(k, n, 0.9) for k in range(n + 1)] for n in range(20, 400, 20)}
    k = np.cumsum(rng.random((300, 400)) < p, axis=1)
    missed = np.zeros(300, bool)
    for n, result in ends.items():
        missed |= [p not in result[failures] for failures in k[:, n - 1]]
    assert missed.mean() > 0.15
