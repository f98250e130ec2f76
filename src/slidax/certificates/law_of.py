"""The surface-based law of a scenario, in continuous time or as an implicit step."""

from __future__ import annotations

from typing import Any

from slidax.controllers import SampledData, SlidingMode
from slidax.scenarios import Scenario


def law_of(scenario: Scenario) -> Any | None:
    """Return the object with transformation, surface, reaching law and bound; None for a law without them."""
    law = scenario.controller
    inner = law.step if isinstance(law, SampledData) else law
    return inner if isinstance(law, SlidingMode) or hasattr(inner, "transformation") else None
