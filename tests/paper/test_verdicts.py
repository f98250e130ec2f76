"""The rule of the verdicts at its edges."""

from __future__ import annotations

import math

import pytest

from slidax.paper import PrintedComparison, compare_limit, compare_printed
from slidax.paper.printed import claim


@pytest.mark.parametrize(
    ("computed", "kind"),
    [
        (100.0, "reproduced"),
        (105.0, "reproduced"),
        (95.0, "reproduced"),
        (105.01, "close"),
        (94.99, "close"),
        (120.0, "close"),
        (80.0, "close"),
        (120.01, "differs"),
        (79.99, "differs"),
        (1000.0, "differs"),
        (0.0, "differs"),
        (math.nan, "unchecked"),
        (math.inf, "unchecked"),
        (None, "unchecked"),
    ],
)
def test_a_number_is_reproduced_within_5_percent_and_close_within_20(computed: float | None, kind: str) -> None:
    assert compare_printed(100.0, computed).kind == kind


@pytest.mark.parametrize(
    ("computed", "text"),
    [
        (100.0, "reproduced within 0.1 %"),
        (102.24, "reproduced within 2.3 %"),
        (97.5, "reproduced within 2.5 %"),
        (107.21, "close: 7.3 % above"),
        (92.0, "close: 8.0 % below"),
        (78.0, "differs: 0.78 times printed"),
        (1.0e6, "differs: 1.0e4 times printed"),
    ],
)
def test_the_words_state_a_bound_that_is_true(computed: float, text: str) -> None:
    assert compare_printed(100.0, computed).text == text


def test_the_rule_does_not_depend_on_the_unit() -> None:
    for scale in (1e-12, 1.0, 1e9):
        assert compare_printed(4.92 * scale, 5.03 * scale) == compare_printed(4.92, 5.03)


def test_a_missing_value_can_have_a_verdict_of_its_own() -> None:
    never = PrintedComparison("differs", "never")
    assert compare_printed(1.0, None, never) == never
    assert compare_printed(1.0, 1.0, never).kind == "reproduced"


def test_a_limit_holds_below_it_only() -> None:
    assert compare_limit(8e-11, 7.99e-11).kind == "reproduced"
    assert compare_limit(8e-11, 8e-11).kind == "differs"
    assert compare_limit(8e-11, 8e-7).text == "does not hold: 1.0e4 times the limit"
    assert compare_limit(8e-11, None).kind == "unchecked"


def test_a_statement_holds_or_does_not() -> None:
    assert (claim(True).kind, claim(False).kind) == ("reproduced", "differs")
