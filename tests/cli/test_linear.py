import json

import numpy as np
import pytest

from .commands import answer_of, in_process

STILL = [
    *("--set", "trajectory={kind: constant, value: [0.3, 0.4]}", "--set", "start.q=[0.3, 0.4]"),
    *("--set", "disturbance.scale=0", "--set", "simulation.t1=0.5", "--set", "actuator={}"),
]


@pytest.mark.full
def test_table_json_and_page_of_a_linearised_loop_agree(tmp_path):
    answer = answer_of("linear", "example-4.1-1khz", *STILL, "--at", "0.4", "--out", str(tmp_path))
    assert answer["stable"] and answer["radius"] < 1.0 and answer["at"] == 0.4
    a = np.array(answer["system"]["A"])
    eigenvalues = [complex(*z) for z in answer["eigenvalues"]]
    np.testing.assert_allclose(max(map(abs, eigenvalues)), answer["radius"], rtol=1e-12)
    np.testing.assert_allclose(np.max(np.abs(np.linalg.eigvals(a))), answer["radius"], rtol=1e-9)
    shown = in_process("linear", "example-4.1-1khz", *STILL, "--at", "0.4", code=0)
    assert f"near t = 0.4 s: stable, spectral radius {answer['radius']:.6g}, {len(a)} states" in shown.stdout
    first = answer["margins"]["torque"]["joints"][0]
    assert f"{first['gain_up']:.3g}" in shown.stdout and "Broken at the measured position" in shown.stdout
    assert json.loads((tmp_path / "linear.json").read_text(encoding="utf-8"))["radius"] == answer["radius"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"spectral radius {answer['radius']:.6g}" in page and "<svg" in page


@pytest.mark.full
def test_unstable_linearised_loop_exits_with_4():
    done = in_process(
        *("linear", "example-4.1-1khz", *STILL, "--at", "0.05", "--set", "scheme.name=pid"),
        *("--set", "scheme.kp=4e6", "--set", "scheme.kd=1", "--set", "simulation.t1=0.05"),
        code=4,
    )
    assert "NOT stable" in done.stdout
