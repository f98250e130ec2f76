import numpy as np
import pytest

from slidax import analysis
from slidax.export.web.playground import playground
from slidax.export.web.settings import ProgramChoice, settings_of
from slidax.scenarios import load

from .played import inputs_of, needs_node, played, rounds_once, scenario_of, variant_of

pytestmark = needs_node

PERIODS = ProgramChoice("simulation.period", "period", "s", (1e-3, 2e-3))

CLOSE = 5e-12
"""Of the largest value of a joint's signal; the search of a sampled-data law ends at 1e-12 rad/s."""


def manifest_of(name, beside=(), choices=(), **changes):
    described = load(name, {path.replace("__", "."): value for path, value in changes.items()}).description
    return playground("test", settings_of(described, "arm", beside, {}, choices), {"arm": "Arm"}, promised=False)


@pytest.fixture(scope="module")
def two_link():
    return manifest_of("example-4.1-1khz", ("printed",), (PERIODS,), simulation__t1=2.0)


def assert_same(manifest, which, folder, tunables=None, choices=None, close=CLOSE, relaxed=True):
    setting = manifest["settings"][which]
    variant = variant_of(setting, choices or {})
    inputs = inputs_of(setting, variant, tunables or {})
    result = played(manifest, variant["program"], inputs, folder, relaxed=relaxed)
    run = scenario_of(setting, {**(tunables or {}), **(choices or {})}).simulate(log_every=int(inputs[-1]))
    log = run.log
    assert result["outcome"]["message"] == run.outcome.message
    assert result["outcome"]["kind"] == run.outcome.kind and result["rows"] == len(log.t)
    pairs = {"q": log.state.q, "e": log.e, "tau": log.tau}
    if log.envelope is not None:
        pairs |= {"lower": log.envelope.lower, "upper": log.envelope.upper}
    for name, array in pairs.items():
        ours, theirs = np.reshape(result["signals"][name], np.shape(array)), np.asarray(array)
        assert np.max(np.abs(ours - theirs) / np.max(np.abs(theirs), axis=0)) <= close, name
    for metric in analysis.summary(run).items():
        assert_metric(*metric, result["metrics"])
    return result


def assert_metric(key, value, actual):
    if isinstance(value, dict):
        for name, item in value.items():
            assert_metric(f"{key}.{name}", item, actual)
    elif value is not None:
        np.testing.assert_allclose(np.asarray(actual[key], float), np.atleast_1d(value), rtol=1e-6, atol=1e-12)


def test_the_page_is_bitwise_equal_to_slidax_with_fused_multiply_adds(two_link, tmp_path):
    if not rounds_once():
        pytest.skip("this node or processor has no multiply-add that is rounded once")
    assert_same(two_link, 0, tmp_path, close=0.0)
    assert_same(two_link, 1, tmp_path, close=0.0)


MOVED = {"robot.plant.masses": [0.7, 1.2], "scheme.transformation.performance.final": 0.01, "scheme.surface.k1": 0.5}


@pytest.mark.parametrize(
    ("tunables", "choices", "relaxed"),
    [({}, {}, True), ({}, {}, False), (MOVED, {"simulation.period": 2e-3}, True)],
    ids=["as it is", "without multiply-adds", "other numbers and another period"],
)
def test_page_computes_the_run_of_slidax(two_link, tmp_path, tunables, choices, relaxed):
    assert_same(two_link, 0, tmp_path, tunables, choices, relaxed=relaxed)


def test_scenarios_with_different_periods_share_one_program(two_link):
    programs = [variant["program"] for variant in two_link["settings"][0]["variants"]]
    assert len(programs) == len(PERIODS.values) and len(set(programs)) == 1


def test_a_run_that_leaves_its_envelope_ends_with_the_message_of_python(two_link, tmp_path):
    result = assert_same(two_link, 1, tmp_path, {"robot.plant.masses": [3.0, 4.0]}, close=1e-6)
    assert result["outcome"]["kind"] in ("left_envelope", "not_finite")


def test_a_run_that_ends_outside_its_envelope_reports_it_as_python_does(two_link, tmp_path):
    result = assert_same(two_link, 0, tmp_path, {"disturbance.scale": 40.0}, close=1e-6)
    assert "is outside at the end" in result["outcome"]["message"]


def test_a_start_outside_the_envelope_is_refused(two_link, tmp_path):
    setting = two_link["settings"][1]
    variant = variant_of(setting, {})
    inputs = inputs_of(setting, variant, {"scheme.transformation.performance.initial": 0.1})
    outcome = played(two_link, variant["program"], inputs, tmp_path)["outcome"]
    assert outcome["kind"] == "refused" and "must hold the start" in outcome["message"]


@pytest.mark.full
def test_a_scheme_without_an_envelope_is_judged_by_the_first_schemes_envelope(tmp_path):
    manifest = manifest_of("example-4.2-1khz", ("super_twisting",), simulation__t1=4.0)
    ours, theirs = (assert_same(manifest, k, tmp_path) for k in (0, 1))
    assert theirs["signals"]["upper"] == ours["signals"]["upper"]
    assert "tolerance_margin" in theirs["metrics"]


@pytest.mark.full
def test_page_of_a_panda_computes_the_run_of_slidax_with_equal_bits_for_encoders(tmp_path):
    exact = manifest_of("panda-payload", sensor__resolution=0.0, sensor__velocity="measured")
    assert_same(exact, 0, tmp_path)
    if not rounds_once():
        pytest.skip("this node or processor has no multiply-add that is rounded once")
    assert_same(manifest_of("panda-payload"), 0, tmp_path, close=0.0)
