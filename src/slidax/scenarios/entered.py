"""Scenarios with a scheme from outside this package."""

from __future__ import annotations

from pydantic import create_model

from slidax.controllers import AbstractController, Preset

from .description import ScenarioDescription
from .schemes import described_scheme


def with_scheme(name: str, scheme: Preset | type[AbstractController]) -> type[ScenarioDescription]:
    """Return the description of scenarios with one external scheme.

    - `name`: its name, `scheme.name` in the scenario.
    - `scheme`: a preset, or the class of a law with a nominal arm and numeric parameters.
    """
    preset = scheme if isinstance(scheme, Preset) else Preset(scheme, (scheme.__doc__ or name).strip())
    return create_model(
        "ScenarioDescription", __base__=ScenarioDescription, scheme=(described_scheme(name, preset), ...)
    )
