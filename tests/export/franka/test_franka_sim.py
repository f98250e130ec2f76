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
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("franka_sim")
    export_franka(scenarios.load(franka.SCENARIO), target, name="law", golden=False)
    CompiledLaw(target / "law")
    return target


@pytest.fixture(scope="module")
def outcomes(folder):
    with franka_chain.serving(scenarios.load(franka.SCENARIO), folder):
        return {fault: franka_chain.moved_in_time(folder, fault) for fault in franka_chain.FAULTS}


def test_the_franka_simulation_runs_for_20_s_without_a_reflex(outcomes, folder):
    text = outcomes["none"]
    assert (text["ending"], text["bridged"]) == ("finished", 0)
    assert text["periods"] > 20_000 and text["largest_error"] < 1e-3
    assert "differ by 0 N m" in franka.compared(CompiledLaw(folder / "law"), folder / "none.csv")


def test_faults_in_the_franka_simulation_end_with_the_documented_status_and_little_motion(outcomes):
    assert outcomes["one-nan"]["ending"] == "finished" and outcomes["one-nan"]["bridged"] == 1
    assert "no good measurement" in outcomes["nan"]["said"] and outcomes["nan"]["ending"] == "stopped"
    assert outcomes["pause"]["ending"] == "reflex"
    assert "communication_constraints_violation" in outcomes["pause"]["said"]
    assert outcomes["gravity"]["ending"] == "stopped" and "weight" in outcomes["gravity"]["said"]
    assert max(text["moved_after"] for text in outcomes.values()) < 0.05
