"""One of a thing has no plural."""

import pytest

from slidax.core.errors import count_noun, each_of
from slidax.studies.study import all_done


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (count_noun(1, "law"), "1 law"),
        (count_noun(0, "law"), "0 laws"),
        (count_noun(2, "entry", "entries"), "2 entries"),
        (count_noun(1, "entry", "entries"), "1 entry"),
        (each_of(1, "joint"), "the joint"),
        (each_of(3, "joint"), "each of the 3 joints"),
        (all_done(1), "the run is done"),
        (all_done(2), "all 2 runs are done"),
    ],
)
def test_a_number_has_its_noun_in_the_right_form(words: str, expected: str) -> None:
    assert words == expected
