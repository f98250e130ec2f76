"""What a page shows of a scenario beside its own law: the law as printed, and rivals with the same estimator."""

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
"""Of schemes; another is called by its name."""

PRINTED = "printed"
"""What is asked for to see the law as it is printed."""

LAYER = 0.05
"""Of the printed law: without one it chatters at once at a robot's rate."""

OURS = "in its form for an arm that is commanded once a period; the envelope is its own"

WITH = "with the same estimator, learning, prediction and limits"

JUDGED = "; it draws no envelope, and is judged by that of our law"


def title_of(scheme: str) -> str:
    """What a page calls a scheme.

    - `scheme`: its name.
    """
    return TITLES.get(scheme, scheme.replace("_", " ").capitalize())


def settings_of(
    description: ScenarioDescription,
    arm: str,
    beside: Sequence[str] = (),
    gains: Mapping[str, Mapping[str, float]] = {},
    choices: Sequence[Choice] = (),
) -> list[Setting]:
    """A scenario's own law, and what is shown beside it.

    - `description`: the scenario.
    - `arm`: label of its arm.
    - `beside`: names of schemes, and `printed` for the law as it is printed.
    - `gains`: of rivals, by their names; their own defaults if not given.
    - `choices`: what has several programs.

    Raises DefinitionError if there is no such scheme, or it has no numbers without being given some.
    """
    own = description.scheme.name
    sampled = description.scheme.sampled_data is not None
    kind = "ours" if sampled else "printed"
    found = [Setting(description, arm, own, title_of(own), kind, choices, OURS if _draws(description) else "")]
    for name in beside:
        if name == PRINTED:
            if sampled:
                found.append(_printed(description, arm, choices))
        elif name != own:
            found.append(_rival(description, arm, name, gains.get(name, {}), choices))
    return found


def _draws(description: ScenarioDescription) -> bool:
    """Whether the law is in sampled-data form, and has an envelope."""
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
        raise DefinitionError(f"there is no scheme `{plain(name)}`; {nearest(name, [*PRESETS, PRINTED])}")
    changes: dict[str, Any] = {"scheme.name": name, **{f"scheme.{gain}": value for gain, value in gains.items()}}
    envelope: Any = getattr(description.scheme, "transformation", None)
    if description.tolerance is None and hasattr(envelope, "performance"):
        # What judges a law that promises no envelope is the one that ours draws.
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
