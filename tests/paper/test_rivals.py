"""The schemes that the paper compares with: what is printed of them, and what their runs give."""

from __future__ import annotations

import numpy as np
import pytest

from slidax import analysis, scenarios
from slidax.paper.claims import run_with_printed_alpha
from slidax.paper.examples import COMPARED, SCHEMES, Case, Runs, cases, scenario_of
from slidax.paper.numbers import chatter, settling_bound, table_3
from slidax.paper.printed import TABLE_3, mark_incomparable
from slidax.simulation import Run


def simulated(case: Case, t1: float) -> Run:
    return scenario_of(case, {"simulation.t1": t1}).simulate(progress=False)


def test_table_3_is_the_papers() -> None:
    assert [items[0].texts for items in TABLE_3.values()] == [
        ("1.37", "1.35", "1.53"),
        ("1.77", "1.47", "1.75"),
        ("1.79", "1.47", "1.76"),
        ("2.20", "2.12", "2.35"),
    ]
    assert [items[1].values[0] for items in TABLE_3.values()] == [4.92e-11, 1.89e-5, 2.81e-6, 3.08e-4]
    assert [items[2].values[2] for items in TABLE_3.values()] == [15.17, 100.52, 39.44, 45.37]
    assert set(TABLE_3) == set(COMPARED["4.2"])


def test_every_scheme_is_run_in_every_way_once() -> None:
    listed = cases(("stated", "off"))
    assert len(listed) == len(set(listed))
    for example, schemes in COMPARED.items():
        for scheme in schemes:
            case = Case(example, "stated", scheme=scheme)
            assert {case, case.halved, case.relayered} <= set(listed)
            reading = SCHEMES[scheme].nearest if example == "4.2" else "stated"
            assert Case(example, reading, scheme=scheme).held in listed


def test_a_case_sets_what_it_says() -> None:
    scenario = scenario_of(Case("4.2", "off", "held", 2e-4, "nftsmc", 3e-4), {})
    assert (scenario.scheme, scenario.stepping.mode, scenario.period) == ("nftsmc", "held", 2e-4)
    assert float(scenario.controller.layer) == 3e-4
    assert scenario.description.disturbance.scale == 0.0


def test_ftsmc_with_the_sign_settles_and_starts_as_computed_elsewhere() -> None:
    run = simulated(Case("4.1", "stated", scheme="ftsmc"), 2.0)
    assert table_3(run, "settling_time", 1e-3) == pytest.approx([1.027, 0.968], abs=0.003)
    assert analysis.peak_torque(run) == pytest.approx([88.21, 66.51], rel=1e-3)
    layered = simulated(Case("4.1", "stated", scheme="ftsmc", layer=0.05), 2.0)
    # Its torque jumps where |e| enters the core of the surface.
    assert table_3(layered, "settling_time", 1e-2) == pytest.approx([0.881, 0.827], abs=1e-3)


def test_anftsmc_without_disturbance_settles_near_the_printed_times() -> None:
    case = Case("4.2", "off", scheme="anftsmc")
    run = simulated(case, 3.0)
    assert table_3(run, "settling_time", 1e-5) == pytest.approx([1.74, 1.45, 1.74], abs=0.03)
    scenario = scenario_of(case, {"simulation.t1": 3.0})
    wrong = run_with_printed_alpha(Runs({case: scenario}, {case: run}, ("off",)))
    assert wrong["peak_torque"] > [100.0 * peak for peak in analysis.peak_torque(run)]


def test_sfsmc_starts_joint_3_as_computed_elsewhere() -> None:
    run = simulated(Case("4.2", "stated", scheme="sfsmc"), 0.1)
    assert analysis.initial_torque(run)[2] == pytest.approx(44.4, rel=0.01)


def test_chattering_is_a_way_that_depends_on_the_step() -> None:
    smooth, rough = (Case("4.1", "stated", scheme="ftsmc", layer=layer) for layer in (0.05, 0.0))
    assert chatter(simulated(smooth, 2.0), simulated(smooth.halved, 2.0)) == [None, None]
    grown = chatter(simulated(rough, 2.0), simulated(rough.halved, 2.0))
    assert all(way is not None and 1.5 < way < 2.5 for way in grown)
    assert mark_incomparable("why").kind == "unchecked"


def test_bounds_have_their_terms_and_sum_up() -> None:
    result = settling_bound(scenarios.load("example-4.1", {"scheme.name": "ftsmc"}))
    assert result is not None
    # K0 = I, k = 1, r = 1.2, n = 2, m1 + m2 = .29; k1 = 1.5, p = .5, k2 = 1, q = 1.2, and 2 for ρ0.
    reaching = [2 / np.sqrt(0.29), 2 / (2**-0.1 * 0.29**1.1 * 0.2)]
    sliding = [2**0.25 / (1.5 * 0.5), 2**-0.1 / 0.2]
    assert result["terms"]["reaching"] == pytest.approx(reaching)
    assert result["terms"]["sliding"] == pytest.approx(sliding)
    assert result["bound"] == pytest.approx(sum(reaching) + sum(sliding))
    assert result["deadlines"] is None
    assert settling_bound(scenarios.load("example-4.2", {"scheme.name": "sfsmc"})) is not None
    assert settling_bound(scenarios.load("example-4.2", {"scheme.name": "nftsmc"})) is None
