"""The exported program on franka-sim, which speaks the robot's protocol and keeps its limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.targets import franka, franka_chain
from slidax import scenarios
from slidax.export.onboard.pilot import CompiledLaw
from slidax.export.robots import export_franka

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(bool(franka_chain.missing()), reason=f"this machine lacks {franka_chain.missing()}"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("franka_sim")
    export_franka(scenarios.load(franka.SCENARIO), made, name="law", golden=False)
    CompiledLaw(made / "law")
    return made


@pytest.fixture(scope="module")
def found(folder: Path) -> dict[str, dict[str, Any]]:
    with franka_chain.serving(scenarios.load(franka.SCENARIO), folder):
        return {fault: franka_chain.moved_in_time(folder, fault) for fault in franka_chain.FAULTS}


def test_ten_seconds_and_more_without_a_reflex(found: dict[str, dict[str, Any]], folder: Path) -> None:
    said = found["none"]
    assert (said["ending"], said["bridged"]) == ("finished", 0)
    assert said["periods"] > 20_000 and said["largest_error"] < 1e-3
    assert "differ by 0 N m" in franka.compared(CompiledLaw(folder / "law"), folder / "none.csv")


def test_faults_end_safely_with_the_status_that_the_page_says(found: dict[str, dict[str, Any]]) -> None:
    assert found["one-nan"]["ending"] == "finished" and found["one-nan"]["bridged"] == 1
    assert "no good measurement" in found["nan"]["said"] and found["nan"]["ending"] == "stopped"
    assert found["pause"]["ending"] == "reflex"
    assert "communication_constraints_violation" in found["pause"]["said"]
    assert found["gravity"]["ending"] == "stopped" and "weight" in found["gravity"]["said"]
    assert max(said["moved_after"] for said in found.values()) < 0.05
