import math
import subprocess
from operator import attrgetter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.export import GuardedStep
from slidax.export.c_project import STEP, project, write_files
from slidax.export.c_structures import constant_bounds, related_valid
from slidax.export.golden_samples import random_samples
from slidax.export.status import HELD, PARAMETERS_INVALID, STOP_REQUESTED
from slidax.plant import TorqueLimits
from slidax.scenarios import load

from .exported import COMPILERS, Exported, needs_a_compiler

BAD = [math.nan, math.inf, -math.inf]


@pytest.fixture(scope="module")
def guard():
    scenario = load("example-4.1-1khz")
    return GuardedStep.around(scenario.controller, scenario.plant.actuator.limits, scenario.period)


def parameters_valid(guard):
    bounds = constant_bounds(guard, "double")
    inside = [
        bool(np.all((np.asarray(leaf) >= bound.low) & (np.asarray(leaf) <= bound.high)))
        for leaf, bound in zip(jax.tree.leaves(guard), bounds, strict=True)
        if bound is not None
    ]
    return all(inside) and bool(related_valid(guard))


def test_the_parameters_of_a_scenario_are_valid(guard):
    assert parameters_valid(guard)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("controller.limits.torque", -math.inf),
        ("controller.limits.torque", 0.0),
        ("controller.limits.rate", math.nan),
        ("controller.period", 0.0),
        ("controller.horizon", 1e-9),
        ("controller.step.surface.k1", -1.0),
        ("controller.step.transformation.performance.final", 0.0),
        ("controller.step.transformation.performance.final", 1e3),
        ("controller.estimator.trend", 5.0),
        ("controller.gate.speed", math.inf),
        ("controller.gate.patience", 1.0),
        ("controller.step.nominal.masses", math.inf),
        ("controller.adaptation.rotor_max", -1.0),
    ],
)
def test_a_parameter_out_of_its_range_is_not_valid(guard, place, value):
    where = attrgetter(place)
    wrong = eqx.tree_at(where, guard, jnp.full_like(where(guard), value))
    assert not parameters_valid(wrong)


def test_an_infinite_limit_is_valid_where_it_means_no_limit(guard):
    endless = eqx.tree_at(
        lambda g: g.controller.limits, guard, TorqueLimits(jnp.full(2, jnp.inf), jnp.full(2, jnp.inf))
    )
    assert parameters_valid(endless)


@needs_a_compiler
@pytest.mark.parametrize("which", ["limits_torque", pytest.param("", marks=pytest.mark.full)])
def test_an_invalid_parameter_at_run_time_is_reported_and_the_torque_stays_finite(guard, which, tmp_path):
    scenario = load("example-4.1-1khz")
    exported = Exported(scenario, tmp_path)
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 8, seed=5)
    good = exported.answers(samples)
    assert not (good.status & HELD).any()
    checked = 0
    for name in filter(lambda name: name.startswith(which), exported.types["parameters"].names):
        wrong = [math.nan, -math.inf, 0.0, -1.0] if name.startswith("limits_") else BAD
        for value in wrong:
            parameters = exported.parameters()
            field = parameters[name].reshape(-1)
            if field.dtype.kind != "f":
                continue
            field[-1] = value
            answers = exported.answers(samples, parameters)
            assert (answers.status & PARAMETERS_INVALID.bit).all(), (name, value)
            assert not (answers.status & ~np.uint32(PARAMETERS_INVALID.bit | STOP_REQUESTED.bit)).any()
            assert np.isfinite(answers.command["tau"]).all(), (name, value)
            checked += 1
    assert checked >= (4 if which else 100)


@needs_a_compiler
@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_compiler_options_that_disable_nan_checks_are_refused(option, tmp_path):
    law = project(load("example-4.1"), name="law", with_golden=False)
    write_files(law, tmp_path, STEP)
    command = [COMPILERS[0], "-std=c99", "-c", "slidax_law.c"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, check=False).returncode == 0
    refused = subprocess.run([*command, option], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert refused.returncode != 0 and "compile without -ffast-math" in refused.stderr
