"""Python and C agree, for every scheme in closed form on every arm."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.export.golden_samples import answer, random_samples, with_bad_numbers
from slidax.export.status import HELD
from slidax.scenarios import catalogue, load

from .agreement import agree, in_full, named
from .exported import Exported, needs_a_compiler

pytestmark = needs_a_compiler

PAIRS = [(arm, scheme, {}) for arm in ("example-4.1", "example-4.2") for scheme in catalogue()["schemes"]]


@pytest.mark.parametrize("pair", in_full(PAIRS, "anftsmc", "cftsmppc"), ids=named)
def test_the_torque_of_c_is_that_of_python(pair, tmp_path):
    agree(pair, tmp_path)


BROKEN = [("example-4.1", "cftsmppc", {}), ("example-4.2-1khz", "cftsmppc", {})]


@pytest.mark.parametrize("pair", in_full(BROKEN, "cftsmppc", "none"), ids=named)
def test_bad_numbers_get_the_status_that_they_get_in_python_and_a_finite_torque_within_its_limits(pair, tmp_path):
    arm, scheme, changes = pair
    scenario = load(arm, {"scheme.name": scheme, "actuator.torque": 50.0, **changes})
    if scenario.plant.actuator is None:
        pytest.fail("this scenario is to have limits")
    exported = Exported(scenario, tmp_path)
    guard = exported.project.guard
    samples = with_bad_numbers(random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=5))
    _, status = answer(guard, samples)
    found = exported.answers(samples)
    np.testing.assert_array_equal(found.status, status)
    assert np.isfinite(found.command["tau"]).all()
    assert (np.abs(found.command["tau"]) <= 50.0).all()
    held = (found.status & HELD) != 0
    assert 0.3 < held.mean() < 1.0
    before = np.asarray(samples.memory.tau)[held]
    np.testing.assert_array_equal(found.command["tau"][held], before)
    np.testing.assert_array_equal(found.memory["t"][held], np.asarray(samples.memory.t)[held])


def test_a_parameter_takes_effect_in_the_step_after_it_was_changed(tmp_path):
    scenario = load("example-4.1")
    exported = Exported(scenario, tmp_path)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 50, seed=6)
    assert exported.project.workspace
    for power in (0.5, 0.6, 0.5):
        changed = eqx.tree_at(lambda g: g.controller.surface.p, guard, jnp.asarray(power))
        parameters = exported.parameters()
        parameters["surface_p"] = power
        command, _ = answer(changed, samples)
        np.testing.assert_allclose(exported.answers(samples, parameters).command["tau"], command.tau, rtol=1e-11)


def test_floats_agree_to_the_digits_that_they_have(tmp_path):
    scenario = load("example-4.2")
    exported = Exported(scenario, tmp_path, single=True)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=8)
    command, _ = answer(guard, samples)
    found = exported.answers(samples)
    tau = np.asarray(command.tau)
    off = np.abs(found.command["tau"] - tau).max(1) / np.abs(tau).max(1)
    assert np.median(off) < 1e-4
    assert np.quantile(off, 0.99) < 1e-2
