"""Designs after their check: accepted, repeated or refused."""

import sys
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from slidax.certify import Verdict
from slidax.design import Refusal, refusal
from slidax.design.candidates import DesignPoint
from slidax.design.trials import CALM, Objective

design = sys.modules["slidax.design.design"]


@dataclass
class Law:
    final: Any
    law: int


def check(margin: float, step: float) -> Verdict:
    bound = {"worst_margin": margin, "steady_torque_step": step, "runs": 10}
    return Verdict("statistical", "", margin > 0, margin, bound, (), "")


@pytest.fixture
def checked(monkeypatch):
    """A function from the margins of successive checks to the design, the seeds and the added cases."""

    def of(
        *margins: float, accuracy: Any = "best", steps: Any = (), required: float | None = None
    ) -> tuple[Any, list[int], list[Any]]:
        result, seeds, harder = iter(margins), [], []
        wild = iter(steps or [0.0] * len(margins))

        def tried(_: Any, __: int, seed: int) -> tuple[Verdict, Any]:
            seeds.append(seed)
            return check(next(result), next(wild)), f"the worst with {seed}"

        trials = SimpleNamespace(space=SimpleNamespace(initial=np.full(1, 1e3), along=False, period=1e-3), runs=0)
        trials.with_harder = lambda cases: harder.append(cases) or trials
        laws = iter(SimpleNamespace(choice=Law(np.full(1, 1.0), k)) for k in range(1, 4))
        aims.clear()
        monkeypatch.setattr(design, "statistical_with_cases", tried)
        monkeypatch.setattr(design, "fine_search", lambda _, __, aim: aims.append(aim))
        monkeypatch.setattr(design, "_aim", lambda *_: Objective(1.0, required is not None, None))
        monkeypatch.setattr(design, "_with_final_radius", lambda *_: next(laws))
        monkeypatch.setattr(design, "_description", lambda *_: SimpleNamespace(build=lambda _: None))
        monkeypatch.setattr(design, "accuracy_refusal", lambda *_: Refusal("no", [], None))
        requirements = SimpleNamespace(accuracy=accuracy, proof="tested", torque_step=required)
        first = SimpleNamespace(choice=Law(np.full(1, 1.0), 0))
        built = design._check(SimpleNamespace(requirements=requirements), trials, first, None, 10, lambda _: None)
        return built, seeds, harder

    of.aims = aims = []
    return of


def test_a_design_with_enough_margin_is_accepted_at_its_first_check(checked):
    built, seeds, harder = checked(0.2)
    assert (built.choice.law, seeds, harder) == (0, [1], [])


def test_a_failed_check_repeats_the_design_with_its_worst_cases_and_a_new_seed(checked):
    built, seeds, harder = checked(-0.1, 0.15)
    assert (built.choice.law, seeds, harder) == (1, [1, 2], ["the worst with 1"])


def test_after_four_checks_the_design_with_the_largest_margin_is_accepted(checked):
    assert checked(0.05, 0.07, -0.1, -0.1)[0].choice.law == 1
    assert checked(0.05, -0.2, -0.1, -0.1)[0].choice.law == 0


def test_a_design_with_a_required_accuracy_is_accepted_with_a_small_margin(checked):
    assert checked(0.01, accuracy=1e-3)[0].choice.law == 0


def test_each_failed_check_widens_the_final_envelope_if_no_accuracy_is_required(checked):
    assert checked(0.2)[0].choice.final == 1.0 and checked(-0.1, 0.2)[0].choice.final == 1.5
    assert checked(-0.1, -0.1, 0.2)[0].choice.final == 1.5**2
    assert checked(-0.1, 0.2, accuracy=1e-3)[0].choice.final == 1.0


def test_design_that_fails_four_checks_is_refused(checked):
    assert isinstance(checked(-0.1, -0.2, -0.1, -0.1)[0], Refusal)


def test_a_large_torque_step_in_the_check_repeats_the_design_with_a_lower_limit(checked):
    assert checked(0.2, 0.2, steps=(0.7, 0.5), required=0.6)[0].choice.law == 1
    # The allowed step is divided by the square root of the excess.
    (aim,) = checked.aims
    assert aim.step == pytest.approx(np.sqrt(CALM * 0.6 / 0.7))
    assert checked(0.2, steps=(0.6,), required=0.6)[0].choice.law == 0
    assert checked(0.2, steps=(0.7,))[0].choice.law == 0


def test_refusal_of_a_torque_step_names_the_smallest_step_of_the_checks(checked):
    built = checked(0.2, 0.2, 0.2, 0.2, steps=(0.7, 0.7, 0.7, 0.65), required=0.6)[0]
    assert isinstance(built, Refusal) and "0.65 N m in the worst of 10 cases" in built.reason
    assert built.would_do[0].changes == {"requirements.torque_step": 0.75}


@pytest.fixture
def certified(monkeypatch):
    """A function from the smallest radius with a bound to the final radius, and True if the bound holds."""

    def of(radius: float, best: bool) -> tuple[float, bool]:
        def verdict_of(law: DesignPoint) -> Verdict:
            return Verdict("tracking_bound", "", bool(law.final[0] >= radius), None, {}, (), "")

        monkeypatch.setattr(design, "tracking_verdict", verdict_of)
        space = SimpleNamespace(initial=np.array([8.0]), described=lambda law: law)
        law, verdict = design._certify(space, DesignPoint(0.01, 1.0, 1.0, np.array([0.5]), 1.0), best)
        return float(law.final[0]), bool(verdict.holds)

    return of


def test_an_envelope_is_widened_until_it_has_a_bound_if_no_accuracy_is_required(certified):
    assert certified(0.4, True) == (0.5, True) and certified(0.65, True) == (0.7, True)
    assert certified(0.65, False) == (0.5, False)


def test_an_envelope_without_a_bound_at_any_width_is_unchanged(certified):
    assert certified(3.0, True) == (0.5, False)


@pytest.mark.parametrize(
    ("accuracy", "certified", "proposed"),
    [(0.1, 0.13, [{"requirements.accuracy": [0.14, 0.28]}]), (0.1, np.inf, []), ("best", 0.13, [])],
    ids=["a wider one is certified", "none is certified", "none is required"],
)
def test_refusal_of_a_bound_proposes_the_smallest_certified_accuracy(monkeypatch, accuracy, certified, proposed):
    def verdict_of(law: Any) -> Verdict:
        return Verdict("tracking_bound", "", bool(law.final[0] >= certified), None, {}, (), "It grows.")

    monkeypatch.setattr(refusal, "tracking_verdict", verdict_of)
    # With exact sensors and a motion that cannot be slowed down there are no other remedies.
    exact, fixed = SimpleNamespace(resolution=0.0), SimpleNamespace(model_dump=lambda **_: {})
    described = lambda law: SimpleNamespace(final=law.final, sensor=exact, trajectory=fixed)  # noqa: E731
    space: Any = SimpleNamespace(initial=np.full(2, 8.0), described=described)
    problem: Any = SimpleNamespace(requirements=SimpleNamespace(accuracy=accuracy), uncertainty={}, robot=fixed)
    law = DesignPoint(0.01, 1.0, 1.0, np.array([0.1, 0.2]), 1.0)
    answer = refusal.proof_refusal(problem, space, law, verdict_of(law))
    *offered, tested = answer.would_do
    assert [dict(item.changes) for item in offered] == proposed
    assert ("accuracy of 0.28" in answer.reason) is bool(proposed)
    assert tested.changes == {"requirements.proof": "tested"}
