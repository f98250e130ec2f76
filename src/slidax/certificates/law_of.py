"""The surface-based law of a scenario, in continuous time or as an implicit step."""

from __future__ import annotations

from typing import Any

from slidax.controllers import SampledData, SlidingMode
from slidax.scenarios import Scenario


def law_of(scenario: Scenario) -> Any | None:
    """What holds transformation, surface, reaching and bound; None for a law without them.

    - `scenario`: whose law.
    """
    law = scenario.controller
    found = law.step if isinstance(law, SampledData) else law
    return found if isinstance(law, SlidingMode) or hasattr(found, "transformation") else None
