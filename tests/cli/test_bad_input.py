"""Bad input ends with exit code 2 and one line that names the field, the rule, the value and the joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from .commands import in_process, own_process

CASES = {
    "scheme.performance.deadline=[5,0]": ["FixedTime.deadline", "> 0", "(eq. 20)", "got 0", "joint 2"],
    "scheme.performance.exponent=[2,2.5]": ["FixedTime.exponent", "> 2", "(eq. 20)", "got 2", "joint 1"],
    "scheme.performance.final=[0.002,0.9]": ["FixedTime.initial", "(eq. 20)", "got 0.6", "joint 2"],
    "scheme.performance.final=-1": ["FixedTime.final", "> 0", "got -1"],
    "scheme.performance.initial=[0.5,0.6]": ["inside the envelope", "(eq. 12)", "got e(0) = -0.6", "joint 1"],
    "scheme.overshoot=[0.2,1]": ["overshoot", "(0, 1)", "(eq. 13)", "got 1", "joint 2"],
    "scheme.overshoot=0": ["overshoot", "(0, 1)", "(eq. 13)", "got 0"],
    "scheme.surface.p=[1.0,0.5]": ["SmoothFixedTime.p", "(0, 1)", "(eq. 29)", "got 1", "joint 1"],
    "scheme.surface.q=[1.2,1]": ["SmoothFixedTime.q", "> 1", "(eq. 34)", "got 1", "joint 2"],
    "scheme.surface.delta=1.5": ["SmoothFixedTime.delta", "(0, 1]", "(eq. 29)", "got 1.5"],
    "scheme.surface.k1=[0.2,-0.2]": ["SmoothFixedTime.k1", "positive definite", "(eq. 40)", "got -0.2", "joint 2"],
    "scheme.surface.k2=0": ["SmoothFixedTime.k2", "positive definite", "(eq. 40)", "got 0"],
    "scheme.reaching.exponent=1": ["FixedTimeReaching.exponent", "> 1", "eq. 43", "got 1"],
    "scheme.reaching.gain=[[1,2],[2,1]]": ["FixedTimeReaching.gain", "positive definite", "eq. 43", "[[1.0, 2.0]"],
    "scheme.reaching.gain=[0.1,-0.1]": ["FixedTimeReaching.gain", "positive definite", "got -0.1", "joint 2"],
    "scheme.reaching.layer=-0.1": ["FixedTimeReaching.layer", ">= 0", "eq. 51", "got -0.1"],
    "scheme.bound.inertia_max=0.05": ["inertia_max", "eq. 47", "got 0.05"],
    "scheme.bound.margin=0": ["UncertaintyBound.margin", "> 0", "eq. 45", "got 0"],
    "scheme.bound.constant=-1": ["UncertaintyBound.b0", ">= 0", "eq. 19", "got -1"],
    "scheme.performance.initial=[1,1,1]": ["FixedTime.final", "2 entries", "`initial` has 3"],
    "scheme.surface.k1=[0.2,0.2,0.2]": ["SmoothFixedTime", "k1", "shape [3]", "2 joints"],
    "disturbance.terms.0.amplitude=[1,1,1]": ["terms.0", "Harmonic.frequency", "2 entries", "`amplitude` has 3"],
    "disturbance.terms.1.amplitude=[1,1,1]": ["disturbance", "amplitude", "shape [3]", "2 joints"],
    "trajectory.offset=[1]": ["trajectory", "amplitudes", "one column per joint"],
    "start.q=[1]": ["start.q", "2 joints", "got 1"],
    "robot.plant.masses=[1,-1]": ["robot.plant", "TwoLink.masses", "> 0", "got -1", "entry 2"],
    "robot.plant.masses=[1]": ["robot.plant", "TwoLink.masses", "2 numbers"],
    "simulation.period=-1e-4": ["simulation.period", "> 0", "-0.0001"],
    "simulation.period=3e-4": ["`t1`", "whole number of periods"],
    "simulation.substeps=0": ["simulation.substeps", ">= 1", "got 0"],
    "simulation.substeps=2": ["substeps`", "1 in continuous mode", "got 2"],
    "simulation.mode=hold": ["simulation.mode", "`hold`", "did you mean `held`?"],
    "simulation.engine=fast": ["simulation.engine", "`fast`", "`auto`, `native`, `xla`"],
    "scheme.name=cftsmpc": ["scheme.name", "`cftsmpc`", "did you mean `cftsmppc`?"],
    "scheme.surfce.k1=1": ["scheme", "unknown key `surfce`", "did you mean `surface`?"],
    "simulaton.period=1": ["unknown key `simulaton`", "did you mean `simulation`?"],
    "trajectory.kind=sinusoidal": ["trajectory.kind", "did you mean `sinusoid`?"],
    "scheme.overshoot=wide": ["scheme.transformation.overshoot", "number or a list of numbers", "'wide'"],
    "scheme.bound=3": ["scheme.bound", "got 3"],
    "disturbance.terms.9.start=1": ["disturbance.terms", "list of 2"],
    "title.x=1": ["`title` is a single value"],
    "scheme.overshoot=.nan": ["overshoot", "got nan"],
    "period": ["--set period", "PATH=VALUE"],
    "scheme.overshoot=[1,": ["not valid YAML"],
}


AT_1_KHZ = {
    "sensor.delay=-1": ["sensor.delay", "must be >= 0", "got -1"],
    "sensor.jitter=-0.5": ["sensor.jitter", "must be >= 0", "got -0.5"],
    "sensor.resolution=[1e-5,1e-5,1e-5]": ["sensor.resolution", "2 joints", "got 3"],
    "sensor.resolution=-1e-5": ["sensor: ", "Encoders.resolution", ">= 0", "got -1e-05"],
    "sensor.position_noise=[0,-1]": ["sensor: ", "Encoders.position_noise", ">= 0", "got -1", "joint 2"],
    "sensor.velocity_noise=-1": ["sensor: ", "Encoders.velocity_noise", ">= 0", "got -1"],
    "sensor.velocity=guessed": ["sensor.velocity", "`guessed`", "`measured`, `differenced`"],
    "sensor={velocity: differenced, velocity_noise: 1e-3}": ["sensor.velocity_noise", "velocity sensor", "got 0.001"],
    "sensor={velocity: differenced, cutoff: 0}": ["sensor: ", "DifferencedEncoders.cutoff", "> 0", "got 0"],
    "sensor.loss.probability=2": ["sensor.loss: ", "Lossy.probability", "[0, 1]", "got 2"],
    "sensor.loss.outages=[{start: 1, samples: -2}]": ["sensor.loss.outages.0.samples", ">= 0", "got -2"],
    "sensor.loss.outages=[{start: -1, samples: 2}]": ["sensor.loss.outages.0.start", ">= 0", "got -1"],
    "sensor.loss.outages=[{start: 1}]": ["sensor.loss.outages.0.samples", "is missing"],
    "sensor.seed=-1": ["sensor.seed", ">= 0", "got -1"],
    "sensor.seed=99999999999999999999": ["sensor.seed", "must be <", "got 99999999999999999999"],
    "sensr.delay=1": ["unknown key `sensr`", "did you mean `sensor`?"],
    "actuator.torque=0": ["actuator: ", "TorqueLimits.torque", "> 0", "got 0"],
    "actuator.torque=[60,60,60]": ["actuator.torque", "2 joints", "got 3"],
    "actuator.torque=[60,-1]": ["actuator: ", "TorqueLimits.torque", "got -1", "joint 2"],
    "actuator.rate=-1": ["actuator: ", "TorqueLimits.rate", "> 0", "got -1"],
    "actuator.time_constant=-1": ["actuator: ", "Actuator.time_constant", ">= 0 s", "got -1"],
    "actuator.time_constant=[0,0,0]": ["actuator.time_constant", "2 joints", "got 3"],
    "actuator.dead_time=-1": ["actuator.dead_time", ">= 0", "got -1"],
    "scheme.sampled_data.horizon=5e-4": ["scheme.sampled_data: ", "`SampledData.horizon`", "0.001 s", "got 0.0005"],
    "scheme.sampled_data.horizon=-1": ["scheme.sampled_data.horizon", "> 0", "got -1"],
    "scheme.sampled_data.horizn=1": ["scheme.sampled_data", "unknown key `horizn`", "did you mean `horizon`?"],
    "scheme.sampled_data.slopes=maybe": ["scheme.sampled_data.slopes", "got 'maybe'"],
    "scheme.sampled_data.estimator={kind: kalmann}": ["sampled_data.estimator.kind", "did you mean `kalman`?"],
    "scheme.sampled_data.estimator={kind: kalman, torque_density: -1}": ["sampled_data.estimator: ", "> 0", "got -1"],
    "scheme.sampled_data.estimator={kind: kalman, variance: [1,1,1]}": ["estimator.variance", "2 joints", "got 3"],
    "scheme.sampled_data.estimator={kind: measured, gain: 2}": ["estimator: ", "Measured.gain", "[0, 1]", "got 2"],
    "scheme.sampled_data.estimator={kind: measured, gain: [0,0,0]}": ["estimator.gain", "2 joints", "got 3"],
    "scheme.sampled_data.estimator={kind: measured, trend: 9}": [
        "Measured.trend",
        "[0, `4 - 2 * gain` = ",
        "got 9",
    ],
    "scheme.sampled_data.estimator={kind: filtered_difference}": ["sampled_data.estimator.cutoff", "is missing"],
    "scheme.sampled_data.estimator={kind: robust_differentiator, lipschitz: 0}": ["lipschitz", "> 0", "got 0"],
    "scheme.sampled_data.recovery.room=1": ["sampled_data.recovery: ", "Recovery.room", "> 1", "got 1"],
    "scheme.sampled_data.recovery.share=2": ["sampled_data.recovery: ", "Recovery.share", "(0, 1)", "got 2"],
    "scheme.sampled_data.recovery.deadline=0": ["sampled_data.recovery: ", "Recovery.deadline", "> 0 s", "got 0"],
    "scheme.reaching.gain=[[1,0],[0,1]]": ["scheme.sampled_data: ", "FixedTimeReaching.gain", "diagonal", "[2, 2]"],
    "simulation.outside=rescue": ["simulation.outside", "`rescue`", "did you mean `recover`?"],
    "simulation={mode: continuous, period: 1e-3, t1: 1}": ["sampled-data law needs samples", "held mode"],
}


def assert_one_line(words: list[str], *arguments: str) -> None:
    result = in_process("run", *arguments, "--json")
    assert result.exit_code == 2
    assert result.stdout == ""
    line = result.stderr.strip()
    assert line.startswith("slidax: ") and "\n" not in line
    for word in words:
        assert word in line


@pytest.mark.parametrize("change", CASES)
def test_a_bad_field_is_one_line_and_exit_code_2(change: str) -> None:
    assert_one_line(CASES[change], "example-4.1", "--set", change)


@pytest.mark.parametrize("change", AT_1_KHZ)
def test_bad_field_of_sensor_actuator_or_sampled_data_is_one_line_and_exit_code_2(change: str) -> None:
    assert_one_line(AT_1_KHZ[change], "example-4.1-1khz", "--set", change)


def test_a_scheme_that_does_not_plan_has_no_horizon() -> None:
    arguments = ("--set", "scheme.name=computed_torque", "--set", "scheme.sampled_data.horizon=0.02")
    words = ["scheme.sampled_data: ", "`ComputedTorque` does not plan over a horizon"]
    assert_one_line(words, "example-4.1-1khz", *arguments)


def test_the_printed_examples_in_continuous_mode_cannot_be_sampled() -> None:
    words = ["sampled-data law needs samples", "simulate in held mode"]
    assert_one_line(words, "example-4.1", "--set", "scheme.sampled_data={}")


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        ("example-4.3", ["unknown scenario `example-4.3`", "did you mean `example-4."]),
        ("nowhere.yaml", ["cannot read", "nowhere.yaml", "No such file"]),
    ],
)
def test_an_unknown_scenario_is_named_with_the_nearest(scenario: str, words: list[str]) -> None:
    result = in_process("run", scenario)
    assert result.exit_code == 2
    assert all(word in result.stderr for word in words)


def test_a_motion_with_an_open_quotation_mark_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "quote.csv"
    path.write_text('time,"a\n0,0\n1,1\n')
    words = ["quote.csv", "line 1", "a quotation mark is not closed"]
    assert_one_line(words, "example-4.1", "--set", f"trajectory={{kind: csv, file: '{path}'}}")


def test_no_traceback_reaches_the_user() -> None:
    result = own_process("run", "example-4.1", "--set", "scheme.overshoot=2")
    assert result.returncode == 2
    assert "Traceback" not in result.stderr and result.stderr.count("\n") == 1
