"""Choice among the candidate laws of a design search."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from slidax.design.candidates import DesignPoint, DesignSpace
from slidax.design.search import fine_search
from slidax.design.trials import CALM, Objective, WorstCase

CHOICE = DesignPoint(0.01, 1.0, 1.0, np.array([0.01]), 1.0)

ANY = Objective(np.inf, False, None)


def worst(error: float, step: float, outside: int = 0) -> WorstCase:
    return WorstCase(CHOICE, -0.1 if outside else 0.1, error, step, 0, 0.5, outside, 8)


def test_the_search_prefers_half_the_error_at_less_than_four_times_the_torque_step():
    exact, calm, both, outside = worst(1.0, 9.0), worst(9.0, 1.0), worst(2.0, 2.0), worst(0.1, 0.1, outside=1)
    assert ANY.best([exact, calm, both, outside]) is both
    assert ANY.best([worst(1.0, 3.9), worst(2.0, 1.0)]).error == 1.0
    assert ANY.best([worst(1.0, 4.1), worst(2.0, 1.0)]).error == 2.0
    # A law that takes a drive to its limit is not admissible, however small its error.
    assert Objective(10.0, False, None).best([worst(1e-3, 10.0), calm]) is calm


def test_a_law_below_the_required_margin_ranks_after_any_law_above_it():
    near, far, outside = worst(0.1, 1.0), replace(worst(9.0, 9.0), margin=0.2), worst(0.1, 0.1, outside=1)
    roomy = Objective(np.inf, False, None, room=0.15)
    assert roomy.best([near, far, outside]) is far and roomy.best([near, outside]) is near
    assert replace(roomy, step=5.0).best([near, far]) is far


def test_among_laws_below_the_required_torque_step_the_smallest_error_wins():
    exact, calm, wild = worst(1.0, 8.0), worst(2.0, 1.0), worst(0.1, 12.0)
    assert Objective(10.0, False, None).best([exact, calm, wild]) is calm
    assert Objective(10.0, True, None).best([exact, calm, wild]) is exact
    assert Objective(10.0, True, None).stricter(0.7).best([exact, calm, wild]) is calm
    assert Objective(8.0 / CALM * 1.001, True, None).best([exact, calm]) is exact


def test_among_laws_that_are_accurate_enough_the_smallest_torque_step_wins():
    exact, calm = worst(1.0, 2.0), worst(9.0, 1.9)
    assert Objective(np.inf, False, 10.0).best([exact, calm]) is calm
    assert Objective(np.inf, False, 5.0).best([exact, calm]) is exact


def test_a_required_certificate_keeps_each_drive_below_its_own_limit():
    strained, free, wild = (
        replace(worst(1.0, 1.0), drive_share=0.95),
        replace(worst(9.0, 9.0), drive_share=0.8),
        worst(0.1, 20.0),
    )
    own = Objective(10.0, False, None, own_share=0.9)
    assert ANY.best([strained, free]) is strained and own.best([strained, free]) is free
    # Among inadmissible laws, a small drive near its limit is better than a large torque step.
    assert own.best([strained, wild]) is strained
    calm = replace(worst(10.0, 1.0), drive_share=0.7)
    assert own.best([replace(calm, error=9.0, drive_share=0.8), calm]).drive_share == 0.8
    assert own.stricter(0.8).best([replace(calm, error=9.0, drive_share=0.8), calm]) is calm


def test_the_narrower_envelope_wins_between_laws_of_equal_error():
    wide = worst(1.0, 1.0)
    narrow = replace(wide, choice=replace(CHOICE, final=np.array([0.005])))
    assert ANY.best([wide, narrow]) is narrow and ANY.best([wide, replace(narrow, error=1.1)]) is wide


def test_the_law_with_the_fewest_failed_cases_wins_if_no_law_holds():
    assert ANY.best([worst(1, 1, 5), worst(9, 9, 2)]).outside == 2
    lost = WorstCase(CHOICE, -np.inf, np.inf, np.inf, 0, -1.0, 2, 8)
    assert np.isfinite(ANY.cost(lost)) and ANY.best([lost, worst(9, 9, 2)]).margin == -0.1


def test_horizons_of_the_search_scale_with_the_period_and_exceed_the_delay():
    def horizons(period: float, delay: float) -> tuple[float, ...]:
        item = np.ones(1)
        return DesignSpace(None, item, item, item, item, period, delay, False, np.inf).horizons

    assert np.allclose(horizons(4e-3, 1.0), 4.0 * np.array(horizons(1e-3, 1.0)))
    assert min(horizons(1e-3, 9.0)) == pytest.approx(20e-3) and horizons(1e-4, 0.0) == horizons(1e-3, 0.0)


def test_torque_densities_keep_their_product_when_equalised_across_joints():
    item, torque = np.ones(2), np.array([80.0, 20.0])
    space = DesignSpace(None, item, item, torque, 40.0 * item, 1e-3, 1.0, False, np.inf)
    shares = [space.density(0.5, even) for even in (0.0, 0.5, 1.0)]
    assert shares[0][0] / shares[0][1] == pytest.approx(16.0)
    assert shares[1][0] / shares[1][1] == pytest.approx(4.0) and shares[2][0] == pytest.approx(shares[2][1])
    assert np.allclose([np.prod(item) for item in shares], np.prod(shares[0]))


def test_a_law_that_holds_in_all_cases_beats_a_more_accurate_law(monkeypatch):
    laws = [replace(CHOICE, slope=float(k)) for k in range(3)]

    class Some:
        problem = SimpleNamespace(requirements=SimpleNamespace(accuracy=1.0))
        space = SimpleNamespace(shape=np.ones(1))

        def widened_cases(self, count: int) -> str:
            return ""

        cases = staticmethod(lambda count: "real")

        def evaluate(self, choices: list[DesignPoint], cases: str) -> list[WorstCase]:
            # The smallest slope gives the smallest error, but an arm of the set leaves its envelope.
            return [
                replace(worst(1.0 + item.slope, 1.0, outside=int(cases == "real" and item.slope < 1.0)), choice=item)
                for item in choices
            ]

    monkeypatch.setattr("slidax.design.search.cmaes_search", lambda trials, *_, **__: trials.evaluate(laws, ""))
    result = fine_search(Some(), replace(worst(9.0, 1.0), choice=replace(CHOICE, slope=8.0)), ANY)
    assert result.holds and result.choice.slope == 1.0
