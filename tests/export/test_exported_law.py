import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.export import export_c
from slidax.export.guarded_step import guarded_law
from slidax.export.robots import export_ur
from tests.export.exported import needs_a_compiler

SCENARIO = scenarios.load("example-4.1-1khz")
pytestmark = needs_a_compiler


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported")
    export_c(SCENARIO, folder, name="law", golden=False)
    return folder


@pytest.fixture
def law(folder):
    return sx.load_export(folder)


def samples(count, scenario=SCENARIO, noise=1e-4):
    rng = np.random.default_rng(1)
    reference = eqx.filter_jit(scenario.trajectory.reference)
    h = scenario.period
    for k in range(count):
        now, following = (reference(jnp.asarray(t)) for t in (k * h, (k + 1) * h))
        q, dq = (np.asarray(part) + rng.normal(scale=noise, size=part.shape) for part in (now.q, now.dq))
        yield k * h, q, dq, now, following


def rows(reference):
    return np.stack([reference.q, reference.dq, reference.ddq])


def assert_same_answers(law, scenario, count, noise=1e-4):
    guard, memory = guarded_law(scenario), None
    init, step = eqx.filter_jit(guard.init), eqx.filter_jit(guard.step)
    for t, q, dq, now, following in samples(count, scenario, noise):
        state = State(jnp.asarray(q), jnp.asarray(dq))
        if memory is None:
            memory = init(jnp.asarray(t), state, now)
        command, status = step(jnp.asarray(t), state, now, following, memory)
        memory = command.memory
        tau, bits = law.step(t, q, dq, rows(now), rows(following))
        assert tau == pytest.approx(np.asarray(command.tau), rel=1e-9, abs=1e-9) and bits == int(status)
    return tau


def test_an_exported_law_answers_as_python_does(law):
    tau = assert_same_answers(law, SCENARIO, 60)
    assert law.signals["tau"].tolist() == tau.tolist() and "s" in law.signals
    assert law.joints == 2 and law.period == pytest.approx(1e-3)


@pytest.mark.full
@pytest.mark.parametrize("name", ["example-4.1-1khz", "panda-payload"])
def test_calm_steps_of_a_law_agree_in_c_and_python(name, tmp_path):
    scenario = scenarios.load(name, {"scheme.sampled_data.calm": True})
    export_c(scenario, tmp_path, name="law", golden=False)
    law = sx.load_export(tmp_path)
    assert_same_answers(law, scenario, 250, noise=1e-7)
    assert law.signals["calm"].all()


def test_a_missing_next_reference_is_the_current_one_continued_at_constant_acceleration(law):
    other, still, h = law.another(), law.another(), law.period
    for t, q, dq, now, _ in samples(20):
        position, velocity, acceleration = wanted = rows(now)
        following = [position + h * velocity + h * h * acceleration / 2, velocity + h * acceleration, acceleration]
        tau = law.step(t, q, dq, wanted)[0]
        assert tau == pytest.approx(other.step(t, q, dq, wanted, following)[0], rel=1e-9, abs=1e-9)
        stopped = still.step(t, q, dq, wanted, wanted)[0]
    assert not np.allclose(tau, stopped, rtol=1e-3)


def test_parameters_of_an_exported_law_are_set_by_name_and_separately_per_instance(law):
    other = law.another()
    name = next(key for key in law if key.startswith("surface"))
    before = law[name]
    law[name] = 1.5 * before
    assert law[name].tolist() == (1.5 * before).tolist() and other[name].tolist() == before.tolist()
    for t, q, dq, now, following in samples(20):
        changed, same = (each.step(t, q, dq, rows(now), rows(following))[0] for each in (law, other))
    assert not np.allclose(changed, same)
    with pytest.raises(DefinitionError, match="unknown parameter `surfacek1`; did you mean"):
        law["surfacek1"] = 1.0


def test_an_invalid_sample_sets_its_status_condition_and_a_reset_restarts_the_law(law):
    t, q, dq, now, following = next(samples(1))
    first, _ = law.step(t, q, dq, rows(now), rows(following))
    held, status = law.step(t, [np.nan, 0.0], dq, rows(now), rows(following))
    assert law.conditions(status) == ["MEASUREMENT_NOT_FINITE"] and held.tolist() == first.tolist()
    law.reset()
    again, _ = law.step(t, q, dq, rows(now), rows(following))
    assert again.tolist() == first.tolist()


def test_wrong_shapes_missing_laws_and_missing_compilers_are_refused(law, tmp_path, monkeypatch):
    with pytest.raises(DefinitionError, match=r"`q` must have shape \[2\]; got \[3\]"):
        law.step(0.0, [0.0] * 3, [0.0] * 2, np.zeros((3, 2)))
    with pytest.raises(DefinitionError, match=r"`now` must have shape \[3, 2\]; got \[2\]"):
        law.step(0.0, [0.0] * 2, [0.0] * 2, np.zeros(2))
    with pytest.raises(DefinitionError, match="has no exported law"):
        sx.load_export(tmp_path)
    monkeypatch.setenv("CC", "no-such-compiler")
    (law.folder / "libslidax_law_flat.so").unlink()
    with pytest.raises(DefinitionError, match="`no-such-compiler` is missing: install a C compiler or set CC"):
        sx.load_export(law.folder)


def test_the_law_of_a_robot_export_can_be_loaded(tmp_path):
    scenario = scenarios.load("ur5e-payload", {"scheme": {"name": "computed_torque"}})
    export_ur(scenario, tmp_path, name="law", golden=False)
    law = sx.load_export(tmp_path)
    q = np.asarray(scenario.state0.q)
    tau, status = law.step(0.0, q, np.zeros(6), np.stack([q, 0 * q, 0 * q]))
    assert tau.shape == (6,) and np.isfinite(tau).all() and law.about["joints"] == 6 and status == 0


def test_a_parameter_of_the_wrong_size_is_refused_with_both_counts(law):
    vector = next(name for name in law if law[name].shape == (2,))
    scalar = next(name for name in law if law[name].shape == ())
    before = {name: law[name].tolist() for name in (vector, scalar)}
    for name, value, words in (
        (vector, [1.0] * 3, "must be one number or 2 numbers; got 3 numbers"),
        (vector, [[1.0, 2.0]], r"must be one number or 2 numbers; got shape \[1, 2\]"),
        (scalar, [1.0, 2.0], "must be one number; got 2 numbers"),
        (scalar, "fast", "must be numbers, or rows of as many numbers each; got 'fast'"),
    ):
        with pytest.raises(DefinitionError, match=f"`{name}` {words}"):
            law[name] = value
    assert {name: law[name].tolist() for name in before} == before
    law[vector] = 0.5
    assert law[vector].tolist() == [0.5, 0.5]


def test_get_returns_the_default_for_an_unknown_parameter_like_any_mapping(law):
    name = next(iter(law))
    assert law.get("typo", 0) == 0 and law.get("typo") is None
    assert law.get(name).tolist() == law[name].tolist()
