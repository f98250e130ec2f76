import numpy as np
import pytest

from slidax import analysis, scenarios
from slidax.core.errors import DefinitionError
from slidax.simulation import Run

FIXED_TIME = {"kind": "fixed_time", "initial": [0.8, 0.6], "final": 0.002, "deadline": [5.0, 6.0], "exponent": 2.01}

OWN = {"performance": FIXED_TIME, "overshoot": 0.2}
"""The envelope of the scenario's own scheme, as a tolerance band."""

NARROW = {"performance": {"kind": "exponential", "initial": 1.0, "final": 0.05, "rate": 20.0}, "overshoot": 0.5}


def run(tolerance, engine="auto", **changes) -> Run:
    changes = {"simulation.t1": 0.4, "simulation.engine": engine, "tolerance": tolerance, **changes}
    return scenarios.load("example-4.1-1khz", changes).simulate(log_every=1, progress=False)


@pytest.mark.parametrize("engine", ["native", "xla"])
def test_a_tolerance_band_equal_to_the_envelope_has_exactly_the_envelope_margin(engine):
    watched = run(OWN, engine, **{"scheme.sampled_data": None})
    np.testing.assert_array_equal(analysis.tolerance_margin(watched), analysis.envelope_margin(watched))
    assert analysis.tolerance_violations(watched) == analysis.envelope_violations(watched) == 0


def test_a_tolerance_band_changes_no_result_and_only_adds_its_metrics():
    plain, watched = run(None), run(NARROW)
    np.testing.assert_array_equal(plain.log.tau, watched.log.tau)
    np.testing.assert_array_equal(plain.log.state.q, watched.log.state.q)
    assert (
        plain.tally.tolerance is None
        and analysis.tolerance_margin(plain) is None
        and analysis.tolerance_violations(plain) is None
    )
    assert "tolerance_margin" not in analysis.summary(plain) and "tolerance_margin" in analysis.summary(watched)


@pytest.mark.parametrize("scheme", ["gravity_pd", "cftsmppc"])
def test_tolerance_violations_and_margin_match_the_full_log(scheme):
    narrow = run(NARROW, **{"scheme.name": scheme})
    rho = 0.95 * np.exp(-20.0 * narrow.log.t)[:, None] + 0.05
    sides = np.where(narrow.log.e[0] >= 0, [[-0.5], [1.0]], [[-1.0], [0.5]])
    lower, upper = sides[0] * rho, sides[1] * rho
    outside = ((narrow.log.e <= lower) | (narrow.log.e >= upper)).any(axis=1)
    assert analysis.tolerance_violations(narrow) == outside.sum() > 0
    nearer = np.minimum(narrow.log.e - lower, upper - narrow.log.e) / (upper - lower)
    np.testing.assert_allclose(analysis.tolerance_margin(narrow), nearer.min(axis=0), rtol=1e-9)
    assert f"Samples outside the tolerance band: {outside.sum()} of 401." in repr(narrow)


def test_a_batch_has_the_tolerance_of_its_scenario_and_may_vary_it():
    scenario = scenarios.load(
        "example-4.1-1khz", {"tolerance": NARROW, "simulation.t1": 0.1, "scheme.name": "gravity_pd"}
    )
    tolerance = scenario.tolerance
    assert tolerance is not None
    many = scenario.simulate_batch(
        lambda part, share: part.replace(tolerance=type(tolerance)(tolerance.performance, share)), np.array([0.5, 0.25])
    )
    single = scenario.simulate(log_every=None)
    violations, margins = analysis.tolerance_violations(many), analysis.tolerance_margin(many)
    assert violations[0] == analysis.tolerance_violations(single)
    np.testing.assert_array_equal(margins[0], analysis.tolerance_margin(single))
    # The error's distance to the nearer bound is unchanged, and the tolerance band is narrower.
    assert np.all(margins[1] != margins[0])


def test_an_invalid_tolerance_band_is_refused_with_the_reason():
    small = {**OWN, "performance": {**FIXED_TIME, "initial": [0.5, 0.6]}}
    with pytest.raises(DefinitionError, match=r"must be inside the tolerance band.*got e\(0\) = -0.6 for joint 1"):
        run(small)
    with pytest.raises(DefinitionError, match=r"tolerance: .*2 joints"):
        run({**OWN, "overshoot": [0.2, 0.2, 0.2]})
    with pytest.raises(DefinitionError, match=r"tolerance.performance.kind"):
        run({**OWN, "performance": {"kind": "wide"}})
