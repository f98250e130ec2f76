"""`slidax run`: the numbers of the paper's examples, from the command line."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from .commands import in_process, own_process


def answered(*arguments: str, code: int = 0) -> dict[str, Any]:
    result = in_process("run", *arguments, "--json")
    assert result.exit_code == code, result.output
    return json.loads(result.stdout)


def test_example_4_1_gives_the_known_numbers() -> None:
    answer = answered("example-4.1")
    metrics = answer["metrics"]
    assert answer["outcome"] == "ok" and answer["stopped"] is None
    np.testing.assert_allclose(metrics["settling_time"]["1e-3"], [1.000, 0.891], atol=0.002)
    np.testing.assert_allclose(metrics["steady_error"], [2.425e-7, 4.363e-7], rtol=0.02)
    np.testing.assert_allclose(metrics["peak_torque"], [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(metrics["initial_torque"], [103.653, 97.039], rtol=5e-4)
    np.testing.assert_allclose(metrics["aice"], [1543.1, 1552.5], rtol=0.01)
    np.testing.assert_allclose(metrics["iae"], [0.2185, 0.4156], rtol=0.01)
    np.testing.assert_allclose(metrics["eci"], [1.0111e7, 1.3003e7], rtol=0.01)
    assert metrics["envelope_violations"] == 0
    assert min(metrics["envelope_margin"]) > 0


def test_held_at_the_same_period_it_is_nearly_the_same() -> None:
    metrics = answered("example-4.1", "--set", "simulation.mode=held")["metrics"]
    np.testing.assert_allclose(metrics["aice"], [1549.5, 1560.7], rtol=0.02)
    assert metrics["envelope_violations"] == 0


def test_example_4_2_without_its_disturbance_has_the_printed_accuracy() -> None:
    metrics = answered("example-4.2", "--set", "disturbance.scale=0")["metrics"]
    np.testing.assert_allclose(metrics["steady_error"], [4.56e-11, 5.75e-11, 2.08e-12], rtol=0.03)
    np.testing.assert_allclose(metrics["settling_time"]["1e-8"], [1.3756, 1.3327, 1.5233], atol=0.002)


def test_example_4_2_with_its_disturbance_has_not() -> None:
    metrics = answered("example-4.2")["metrics"]
    np.testing.assert_allclose(metrics["steady_error"], [5.04e-7, 6.58e-7, 7.80e-7], rtol=0.01)
    np.testing.assert_allclose(metrics["peak_torque"], [9.54, 8.65, 14.43], rtol=0.001)


def test_the_json_has_every_field_that_was_promised() -> None:
    answer = answered("example-4.1", "--set", "simulation.t1=0.1")
    assert list(answer) == [
        *("scenario", "robot", "scheme", "n", "period", "t1", "outcome", "stopped", "metrics", "timing"),
    ]
    assert (answer["scenario"], answer["robot"], answer["scheme"]) == ("example-4.1", "two_link", "cftsmppc")
    assert (answer["n"], answer["period"], answer["t1"]) == (2, 1e-4, 0.1)
    assert list(answer["metrics"]["settling_time"]) == ["1e-2", "1e-3", "1e-4", "1e-5", "1e-8"]
    assert answer["timing"]["steps"] == 1000
    assert all(answer["timing"][key] >= 0 for key in ("import_s", "compile_s", "run_s"))
    per_joint = [value for value in answer["metrics"].values() if isinstance(value, list)]
    assert len(per_joint) == 9 and all(len(value) == 2 for value in per_joint)


@pytest.mark.parametrize("mode", ["continuous", "held"])
def test_a_run_that_must_leave_its_envelope_exits_with_3_and_no_nan(mode: str) -> None:
    result = own_process(
        "run", "example-4.1", "--json", "--set", "simulation.period=1e-3", "--set", f"simulation.mode={mode}"
    )
    assert result.returncode == 3
    answer = json.loads(result.stdout, parse_constant=lambda word: pytest.fail(f"{word} in the JSON"))
    assert answer["outcome"] == "left_envelope"
    assert answer["stopped"]["joint"] == 1
    assert abs(answer["stopped"]["error"]) >= abs(answer["stopped"]["bound"]) > 0
    assert 4.5 < answer["stopped"]["t"] < 6.0
    assert answer["metrics"]["steady_error"] is None
    assert answer["metrics"]["peak_torque"][0] > 0
    assert "Joint 1 left its envelope at t = " in result.stderr


def test_another_scheme_by_name_takes_the_place_of_the_files() -> None:
    answer = answered("example-4.1", "--set", "scheme.reaching.layer=0.05", "--set", "scheme.name=ftsmc")
    assert (answer["scheme"], answer["outcome"]) == ("ftsmc", "ok")
    assert answer["metrics"]["envelope_violations"] is None
    np.testing.assert_allclose(answer["metrics"]["steady_error"], [1.99e-4, 3.77e-4], rtol=0.01)


def test_the_same_command_gives_the_same_bits() -> None:
    arguments = ("example-4.2", "--set", "simulation.t1=1")
    assert answered(*arguments)["metrics"] == answered(*arguments)["metrics"]
