"""Bad input ends with exit code 2 and one line that names the field, the rule, the value and the joint."""

from __future__ import annotations

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
    "scheme.bound.constant=-1": ["UncertaintyBound.constant", ">= 0", "eq. 19", "got -1"],
    "scheme.performance.initial=[1,1,1]": ["FixedTime.final", "2 entries", "`initial` has 3"],
    "scheme.surface.k1=[0.2,0.2,0.2]": ["SmoothFixedTime", "k1", "shape [3]", "2 joints"],
    "disturbance.terms.0.amplitude=[1,1,1]": ["terms.0", "Harmonic.frequency", "2 entries", "`amplitude` has 3"],
    "disturbance.terms.1.amplitude=[1,1,1]": ["disturbance", "amplitude", "shape [3]", "2 joints"],
    "trajectory.offset=[1]": ["trajectory", "amplitudes", "one column per joint"],
    "start.q=[1]": ["start.q", "2 joints", "got 1"],
    "robot.plant.masses=[1,-1]": ["robot.plant", "TwoLink.masses", "> 0", "got -1", "joint 2"],
    "robot.plant.masses=[1]": ["robot.plant", "TwoLink.masses", "2 numbers"],
    "simulation.period=-1e-4": ["simulation.period", "> 0", "-0.0001"],
    "simulation.period=3e-4": ["`t1`", "whole number of periods"],
    "simulation.substeps=0": ["simulation.substeps", ">= 1", "got 0"],
    "simulation.substeps=2": ["`substeps`", "1 in continuous mode", "got 2"],
    "simulation.mode=hold": ["simulation.mode", "`hold`", "did you mean `held`?"],
    "simulation.engine=fast": ["simulation.engine", "`fast`", "`auto`, `xla`"],
    "scheme.name=cftsmpc": ["scheme.name", "`cftsmpc`", "did you mean `cftsmppc`?"],
    "scheme.surfce.k1=1": ["scheme", "unknown key `surfce`", "did you mean `surface`?"],
    "simulaton.period=1": ["unknown key `simulaton`", "did you mean `simulation`?"],
    "trajectory.kind=sinusoidal": ["trajectory.kind", "did you mean `sinusoid`?"],
    "scheme.overshoot=wide": ["scheme.overshoot", "number or a list of numbers", "'wide'"],
    "scheme.bound=3": ["scheme.bound", "got 3"],
    "disturbance.terms.9.start=1": ["disturbance.terms", "list of 2"],
    "title.x=1": ["`title` is a single value"],
    "scheme.overshoot=.nan": ["overshoot", "got nan"],
    "period": ["--set period", "PATH=VALUE"],
    "scheme.overshoot=[1,": ["not valid YAML"],
}


@pytest.mark.parametrize("change", CASES)
def test_a_bad_field_is_one_line_and_exit_code_2(change: str) -> None:
    result = in_process("run", "example-4.1", "--json", "--set", change)
    assert result.exit_code == 2
    assert result.stdout == ""
    line = result.stderr.strip()
    assert line.startswith("slidax: ") and "\n" not in line
    for words in CASES[change]:
        assert words in line


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


def test_no_traceback_reaches_the_user() -> None:
    result = own_process("run", "example-4.1", "--set", "scheme.overshoot=2")
    assert result.returncode == 2
    assert "Traceback" not in result.stderr and result.stderr.count("\n") == 1
