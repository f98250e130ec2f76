"""Scenarios with a scheme that is not of this package."""

from __future__ import annotations

from pydantic import create_model

from slidax.controllers import AbstractController, Preset

from .description import ScenarioDescription
from .schemes import described_scheme


def with_scheme(name: str, scheme: Preset | type[AbstractController]) -> type[ScenarioDescription]:
    """The form of scenarios that have one scheme, from wherever it is.

    - `name`: what to call it; `scheme.name` in the scenario.
    - `scheme`: a preset, or the class of a law that a nominal arm and numbers make.
    """
    preset = scheme if isinstance(scheme, Preset) else Preset(scheme, (scheme.__doc__ or name).strip())
    return create_model(
        "ScenarioDescription", __base__=ScenarioDescription, scheme=(described_scheme(name, preset), ...)
    )
