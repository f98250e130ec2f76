"""All certificates of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario

from .admissibility import admissibility
from .continuous import printed_period, settling_time, ultimate_bound
from .members import family_of
from .statistical import RUNS, statistical
from .verdict import Assumption, Verdict

CERTIFICATES: tuple[Callable[[Scenario], Verdict], ...] = (
    admissibility,
    printed_period,
    settling_time,
    ultimate_bound,
)
"""All but the statistical one, in the order in which they are shown."""


@dataclass(frozen=True)
class Certificates:
    """What is promised of a scenario.

        certified = slidax.certify(scenario)
        certified.holds
        certified["loop_rate"].bound

    - `scenario`: its name.
    - `verdicts`: of the certificates, in the order in which they are shown.
    """

    scenario: str
    verdicts: Sequence[Verdict]

    @property
    def holds(self) -> bool:
        """Whether each certificate that applies holds."""
        return not self.failing

    @property
    def failing(self) -> list[str]:
        """The names of those that do not hold."""
        return [one.name for one in self.verdicts if one.holds is False]

    def __getitem__(self, name: str) -> Verdict:
        for one in self.verdicts:
            if one.name == name:
                return one
        raise KeyError(name)

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.verdicts)

    def as_json(self) -> dict[str, Any]:
        """As `slidax certify --json` prints it."""
        return {"certificates": [one.as_json() for one in self.verdicts]}


def certify(scenario: Scenario, *, runs: int = RUNS, seed: int = 0) -> Certificates:
    """Each certificate's answer for a scenario.

    - `scenario`: what is asked about, with its block `uncertainty`.
    - `runs`: of the statistical certificate; with 0 it is left out.
    - `seed`: of these runs.

    Raises DefinitionError if the scenario was changed in Python, so that no file says what it is, or its block
    `uncertainty` is invalid.
    """
    if scenario.changed:
        raise DefinitionError(
            f"`{scenario.name}` was changed by `replace` ({', '.join(scenario.changed)}): certify a scenario as `load` "
            "or `altered` give it"
        )
    # A set that is empty, or leads nowhere, is a mistake in the scenario and no answer of a certificate.
    family_of(scenario)
    asked = [*((one.__name__, one) for one in CERTIFICATES)]
    if runs:
        asked.append((statistical.__name__, lambda one: statistical(one, runs, seed)))
    return Certificates(scenario.name, tuple(_answer(name, one, scenario) for name, one in asked))


def _answer(name: str, certificate: Callable[[Scenario], Verdict], scenario: Scenario) -> Verdict:
    """Its verdict; where it refuses the scenario, its reason, which the other certificates are no part of."""
    try:
        return certificate(scenario)
    except DefinitionError as error:
        refused = Assumption(str(error), "fails")
        return Verdict(name, name.replace("_", " "), False, None, {}, (refused,), f"Not certified: {error}.")
