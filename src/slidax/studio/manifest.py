"""Manifest of a scenario, the data from which the page builds its controls: arm, laws, choices and sliders."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

import slidax
from slidax.core.errors import DefinitionError
from slidax.export.web.playground import arm_entry, playground
from slidax.export.web.settings import PageSetting
from slidax.export.web.tunables import tunables_of
from slidax.scenarios.load import alter_description
from slidax.scenarios.scenario import Scenario, ScenarioDescription

RIVALS = {
    "computed_torque": "computed torque + PD",
    "slotine_li": "Slotine-Li",
    "super_twisting": "super-twisting",
}
"""Schemes that the page offers in addition to the scenario's own, with the same estimator; titles by name."""

PERIODS = (0.5, 1.0, 2.0, 4.0)
"""Selectable multiples of the scenario's sample time."""

DELAYS = (0, 1, 2, 3)
"""Selectable measurement delays [periods]."""

PROGRAM = "server"


def manifest_of(scenario: Scenario) -> dict[str, Any]:
    """Return the manifest of a `scenario`: its own law and other laws, with choices and sliders.

    A variant is a combination of the choices, which are period and delay. The server simulates every variant.
    """
    description = scenario.description
    joints = int(scenario.state0.q.size)
    settings = [_setting(description, scenario.scheme, scenario.scheme, "ours", joints)]
    if "sampled_data" in type(description.scheme).model_fields and description.scheme.sampled_data is not None:
        changes = {"scheme.sampled_data": None}
        settings += _other(description, changes, "printed", f"{scenario.scheme} as printed", "printed", joints)
    for name, title in RIVALS.items():
        if name != scenario.scheme:
            settings += _other(description, {"scheme.name": name}, name, title, "rival", joints)
    torque, rate = _limits(scenario)
    arm = scenario.robot
    return {
        "format": 1,
        "title": description.title or scenario.name,
        "made_by": f"slidax {slidax.__version__}",
        "first": {"arm": arm, "scheme": settings[0]["scheme"]},
        "arms": [
            arm_entry(scenario.plant.robot, arm, arm.replace("_", " "), torque, rate, scenario.trajectory, scenario.t1)
        ],
        "programs": [{"id": PROGRAM, "engine": "server", "inputs": 0, "signals": [], "rows": 0, "log_every": 0.0}],
        "settings": [setting | {"arm": arm} for setting in settings],
    }


def compiled_manifest_of(scenario: Scenario) -> dict[str, Any]:
    """Return the manifest of a `scenario`, with its own law as WebAssembly that the page runs.

    The page runs only the variant with the scenario's own period and delay. The server simulates all others.

    Raises DefinitionError if the law cannot be compiled for a page.
    """
    manifest = manifest_of(scenario)
    first, arm = manifest["settings"][0], manifest["arms"][0]
    setting = PageSetting(scenario.description, first["arm"], first["scheme"], first["title"])
    compiled = playground(manifest["title"], [setting], {arm["id"]: arm["title"]})
    own, at = compiled["settings"][0], [choice["default"] for choice in first["choices"]]
    (variant,) = own["variants"]
    first["variants"] = [variant | {"at": at} if variant_["at"] == at else variant_ for variant_ in first["variants"]]
    first |= {name: own[name] for name in ("tunables", "constants", "certificates", "c_files", "c_parameters")}
    manifest["programs"] += compiled["programs"]
    return manifest


def _other(
    description: ScenarioDescription, changes: dict[str, Any], scheme: str, title: str, kind: str, joints: int
) -> list[dict[str, Any]]:
    """Return the setting of another scheme as a list; empty if the scheme does not fit the scenario."""
    try:
        return [_setting(alter_description(description, changes), scheme, title, kind, joints)]
    except DefinitionError:
        return []


def _setting(description: ScenarioDescription, scheme: str, title: str, kind: str, joints: int) -> dict[str, Any]:
    resolved = description.model_copy(update={"robot": description.robot.resolved()})
    choices = _choices(description)
    return {
        "scheme": scheme,
        "title": title,
        "kind": kind,
        "printed": kind == "printed",
        "note": "",
        "choices": choices,
        "variants": _variants([len(choice["values"]) for choice in choices]),
        "tunables": [tunable.entry(0) for tunable in tunables_of(resolved, joints)],
        "constants": None,
        "scenario": json.loads(json.dumps(resolved.model_dump(exclude_unset=True), default=_listed)),
        "c_files": None,
        "c_parameters": None,
        "certificates": [],
    }


def _choices(description: ScenarioDescription) -> list[dict[str, Any]]:
    period, delay = description.simulation.period, description.sensor.delay
    choices = [
        {
            "path": "simulation.period",
            "title": "period",
            "unit": "s",
            "values": [float(f"{factor * period:.6g}") for factor in PERIODS],
            "default": PERIODS.index(1.0),
        }
    ]
    if description.simulation.mode == "held" and isinstance(delay, int | float):
        values = sorted({*DELAYS, delay})
        choices.append(
            {
                "path": "sensor.delay",
                "title": "delay",
                "unit": "periods",
                "values": values,
                "default": values.index(delay),
            }
        )
    return choices


def _variants(counts: list[int]) -> list[dict[str, Any]]:
    return [{"at": list(map(int, at)), "program": PROGRAM} for at in np.ndindex(*counts)]


def _limits(scenario: Scenario) -> tuple[Any, Any]:
    actuator = getattr(scenario.plant, "actuator", None)
    if actuator is None:
        return np.inf, np.inf
    return np.asarray(actuator.limits.torque), np.asarray(actuator.limits.rate)


def _listed(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else list(value)
