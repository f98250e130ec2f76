import subprocess
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core import State
from slidax.export import GuardedStep
from slidax.export.c_project import STEP, project, write_files
from slidax.export.golden_samples import record_closed_loop
from slidax.export.status import MEASUREMENT_REJECTED
from slidax.plant import AbstractSensor, Measurement
from slidax.scenarios import load

from .exported import COMPILERS, Exported, needs_a_compiler

pytestmark = needs_a_compiler

CAMPAIGN = Path(__file__).with_name("campaign") / "campaign.c"
KINDS = 20

EXPORTS = ["panda-payload", "ur5e-payload", "example-4.1-1khz", "example-4.2-1khz"]


def disturbed(name, single, times, seed, folder):
    scenario = load(name)
    law = project(scenario, name="law", single=single, with_golden=False)
    write_files(law, folder, STEP)
    performance = scenario.controller.step.transformation.performance
    sources = ["slidax_law.c", "slidax_law_scenario.c", str(CAMPAIGN)]
    real = f"-DREAL={'float' if single else 'double'}"
    # gnu11: the campaign itself is no part of an export.
    command = [COMPILERS[0], "-std=gnu11", "-O1", real, "-I.", *sources, "-o", "campaign", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    deadline = f"{float(performance.deadline.max()):g}"
    done = subprocess.run(
        ["./campaign", str(times), str(seed), deadline], cwd=folder, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-3000:]}"
    return done.stdout


@pytest.mark.parametrize(("name", "single"), [("panda-payload", False), ("example-4.1-1khz", True)])
def test_joints_return_in_time_after_a_sensor_fault_or_a_stop_is_requested(name, single, tmp_path):
    report = disturbed(name, single, 6, 1, tmp_path)
    assert f"all: {6 * KINDS} runs, 0 bad" in report


@pytest.mark.full
@pytest.mark.parametrize("single", [False, True], ids=["doubles", "floats"])
@pytest.mark.parametrize("name", EXPORTS)
def test_sensor_faults_at_200_random_times_do_not_make_an_exported_law_diverge(name, single, tmp_path):
    report = disturbed(name, single, 200, 11, tmp_path)
    print(f"{name}, {'floats' if single else 'doubles'}\n{report}")
    assert f"all: {200 * KINDS} runs, 0 bad" in report


class Disturbed(AbstractSensor):
    """A sensor with outliers in position and velocity, swapped joints and frozen samples, drawn from a seed."""

    inner: AbstractSensor | None
    q: Any
    dq: Any
    fault: Any

    @classmethod
    def drawn(cls, inner, joints, samples, seed):
        rng = np.random.default_rng(seed)
        kind = np.where(rng.random(samples) < 0.02, rng.integers(1, 4, samples), 0)
        kind[: samples // 8] = 0
        size = 10.0 ** rng.uniform(-1.0, 6.0, (2, samples, joints)) * rng.choice([-1.0, 0.0, 1.0], (2, samples, joints))
        return cls(inner, jnp.asarray(size[0]), jnp.asarray(size[1]), jnp.asarray(kind))

    def init(self, state):
        inner = () if self.inner is None else self.inner.init(state)
        return state, inner

    def __call__(self, k, state, period, memory):
        last, inner = memory
        fresh = jnp.asarray(True)
        if self.inner is not None:
            measurement, inner = self.inner(k, state, period, inner)
            state, fresh = measurement.state, measurement.fresh
        at = jnp.minimum(k, self.fault.shape[0] - 1)
        kind = self.fault[at]
        outlier = State(q=state.q + self.q[at], dq=state.dq + self.dq[at])
        swapped = State(q=state.q[::-1], dq=state.dq[::-1])

        def pick(good, *wrong):
            for number, value in enumerate(wrong, start=1):
                good = jnp.where(kind == number, value, good)
            return good

        measured = State(pick(state.q, outlier.q, swapped.q, last.q), pick(state.dq, outlier.dq, swapped.dq, last.dq))
        return Measurement(state=measured, fresh=fresh), (measured, inner)


@pytest.mark.parametrize(
    "name", ["example-4.1-1khz", *(pytest.param(name, marks=pytest.mark.full) for name in EXPORTS if "4.1" not in name)]
)
def test_c_and_python_agree_in_a_run_with_sensor_faults(name, tmp_path):
    scenario = load(name, {"simulation.t1": 2.0, "simulation.outside": "recover"})
    guard = GuardedStep.around(scenario.controller, scenario.plant.actuator.limits, scenario.period)
    samples = round(2.0 / scenario.period) + 1
    sensor = Disturbed.drawn(scenario.plant.sensor, guard.joints, samples, 7)
    plant = eqx.tree_at(lambda plant: plant.sensor, scenario.plant, sensor, is_leaf=lambda x: x is None)
    recording = record_closed_loop(scenario.replace(plant=plant), guard)
    answers = Exported(scenario, tmp_path).answers(recording.samples)
    np.testing.assert_array_equal(answers.status, recording.status)
    rejected = (recording.status & MEASUREMENT_REJECTED.bit) != 0
    assert 3 < rejected.sum() < samples // 10
    # The plan is computed to 1e-12 rad/s, so the last digits of a torque depend on the compiler.
    tolerance = 1e-12 * np.abs(recording.tau).max()
    np.testing.assert_allclose(answers.command["tau"], recording.tau, rtol=0, atol=tolerance)
    same = float(np.mean(answers.command["tau"] == recording.tau))
    print(f"{name}: all statuses and {100 * same:.1f} % of the torques are the same to the last bit")
