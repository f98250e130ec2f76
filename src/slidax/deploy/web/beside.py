"""Laws that a page shows next to a scenario's own: the law as printed, and rivals with the same estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from slidax._errors import DefinitionError, nearest, plain
from slidax.scenarios import ScenarioDescription
from slidax.scenarios.load import validated
from slidax.scenarios.schemes import PRESETS

from .setting import Choice, Setting

TITLES = {
    "cftsmppc": "CFTSMPPC",
    "ftsmppc": "FTSMPPC",
    "ftsmc": "FTSMC",
    "sfsmc": "SFSMC",
    "sfsmppc": "SFSMPPC",
    "computed_torque": "Computed torque + PD",
    "slotine_li": "Slotine-Li",
    "super_twisting": "Super-twisting",
    "pid": "PID",
}
"""Titles of schemes; others keep their names."""

PRINTED = "printed"
"""Requests the law as printed."""

LAYER = 0.05
"""Boundary layer of the printed law, which chatters at a robot's rate without one."""

OURS = "in its form for an arm that is commanded once a period; the envelope is its own"

WITH = "with the same estimator, adaptation, prediction and limits"

JUDGED = "; it has no envelope, and is judged by that of our law"


def title_of(scheme: str) -> str:
    """A scheme's title on a page."""
    return TITLES.get(scheme, scheme.replace("_", " ").capitalize())


def settings_of(
    description: ScenarioDescription,
    arm: str,
    compared: Sequence[str] = (),
    gains: Mapping[str, Mapping[str, float]] = {},
    choices: Sequence[Choice] = (),
) -> list[Setting]:
    """A scenario's own law, and the laws to compare.

    - `arm`: label of its arm.
    - `compared`: names of schemes, and `printed` for the law as printed.
    - `gains`: of rivals, by their names; by default those of the schemes.
    - `choices`: values that need programs of their own.

    Raises DefinitionError if there is no such scheme, or it has parameters without defaults.
    """
    own = description.scheme.name
    sampled = description.scheme.sampled_data is not None
    kind = "ours" if sampled else "printed"
    settings = [Setting(description, arm, own, title_of(own), kind, choices, OURS if _draws(description) else "")]
    for name in compared:
        if name == PRINTED:
            if sampled:
                settings.append(_printed(description, arm, choices))
        elif name != own:
            settings.append(_rival(description, arm, name, gains.get(name, {}), choices))
    return settings


def _draws(description: ScenarioDescription) -> bool:
    """True if the law is in sampled-data form and has an envelope."""
    transformation = getattr(description.scheme, "transformation", None)
    return description.scheme.sampled_data is not None and hasattr(transformation, "performance")


def _printed(description: ScenarioDescription, arm: str, choices: Sequence[Choice]) -> Setting:
    own = description.scheme.name
    changes: dict[str, Any] = {"scheme.sampled_data": None, "simulation.outside": "raise"}
    note = "as printed: no estimator, no prediction, no limits known to it"
    reaching = getattr(description.scheme, "reaching", None)
    if getattr(reaching, "layer", None) == 0.0:
        changes["scheme.reaching.layer"] = LAYER
        note += f"; with a layer of {LAYER:g}, as without one it chatters at once"
    return Setting(_with(description, changes), arm, f"{own}-printed", f"{title_of(own)}, as printed", "printed",
                   choices, note)  # fmt: skip


def _rival(
    description: ScenarioDescription, arm: str, name: str, gains: Mapping[str, float], choices: Sequence[Choice]
) -> Setting:
    if name not in PRESETS:
        raise DefinitionError(f"scheme `{plain(name)}` does not exist; {nearest(name, [*PRESETS, PRINTED])}")
    changes: dict[str, Any] = {"scheme.name": name, **{f"scheme.{gain}": value for gain, value in gains.items()}}
    envelope: Any = getattr(description.scheme, "transformation", None)
    if description.tolerance is None and hasattr(envelope, "performance"):
        # A law without an envelope is judged by that of our law.
        changes["tolerance"] = {
            key: value for key, value in envelope.model_dump(exclude_unset=True).items() if key != "kind"
        }
    rival = _with(description, changes)
    note = WITH if description.scheme.sampled_data is not None else ""
    if note and "tolerance" in changes and not _draws(rival):
        note += JUDGED
    return Setting(rival, arm, name, title_of(name), "rival", choices, note)


def _with(description: ScenarioDescription, changes: dict[str, Any]) -> ScenarioDescription:
    return validated(description.model_dump(exclude_unset=True), changes, form=type(description))
