"""What a page says of a law and of those beside it."""

from __future__ import annotations

from slidax.export.web.settings import JUDGED, OURS, WITH, settings_of
from slidax.scenarios import load


def test_each_law_says_whose_envelope_judges_it() -> None:
    laws = settings_of(load("example-4.1-1khz").description, "arm", ["printed", "slotine_li", "slotine_li_ppc"])
    notes = {law.scheme: law.note for law in laws}
    assert notes["cftsmppc"] == OURS
    assert notes["slotine_li"] == WITH + JUDGED
    assert notes["slotine_li_ppc"] == WITH, "it draws an envelope of its own"
    assert "as printed" in notes["cftsmppc-printed"]


def test_a_law_in_continuous_time_is_not_said_to_be_in_another_form() -> None:
    (own,) = settings_of(load("example-4.1").description, "arm")
    assert own.note == ""
