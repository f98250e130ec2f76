"""All certificates of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, wraps
from typing import Any

from slidax._errors import DefinitionError
from slidax.numerics import require_64_bits
from slidax.scenarios import Scenario

from .admissibility import admissibility
from .arm import demand, robust_torque, torque_budget, uncertainty_bound
from .certificate import Certificate
from .continuous import printed_period, settling_time, ultimate_bound
from .demand import Demand
from .loop import inertia_ratio, loop_rate
from .members import family_of
from .statistical import RUNS, statistical
from .verdict import Assumption, Verdict


@lru_cache(maxsize=2)
def _demand(scenario: Scenario) -> Demand:
    return demand(scenario)


def _with_demand(certificate: Certificate[...]) -> Certificate[...]:
    """The certificate with the scenario's demand, which is computed once for all certificates that need it."""

    @wraps(certificate.judge)
    def judge(scenario: Scenario) -> Verdict:
        return certificate.judge(scenario, _demand(scenario))

    return replace(certificate, judge=judge)


CERTIFICATES: tuple[Certificate[...], ...] = (
    admissibility,
    _with_demand(inertia_ratio),
    loop_rate,
    _with_demand(robust_torque),
    _with_demand(torque_budget),
    uncertainty_bound,
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


def certify(
    scenario: Scenario,
    *,
    runs: int = RUNS,
    seed: int = 0,
    without: Sequence[str] = (),
    known: Sequence[Verdict] = (),
) -> Certificates:
    """Each certificate's answer for a scenario.

    - `scenario`: what is asked about, with its block `uncertainty`.
    - `runs`: of the statistical certificate; with 0 it is left out.
    - `seed`: of these runs.
    - `without`: names of certificates that are left out.
    - `known`: answers for this scenario that are there already, which are not asked for again.

    Raises DefinitionError if the scenario was changed in Python, so that no file says what it is, or its block
    `uncertainty` is invalid, or JAX has 32-bit numbers.
    """
    require_64_bits()
    if scenario.changed:
        raise DefinitionError(
            f"`{scenario.name}` was changed by `replace` ({', '.join(scenario.changed)}): certify a scenario as `load` "
            "or `altered` give it"
        )
    # A set that is empty, or leads nowhere, is a mistake in the scenario and no answer of a certificate.
    family_of(scenario)
    asked: list[tuple[str, Callable[[Scenario], Verdict]]]
    asked = [(one.name, one) for one in CERTIFICATES if one.name not in without]
    if runs:
        asked.append((statistical.__name__, lambda one: statistical(one, runs, seed)))
    answers = {one.name: one for one in known}
    found = (answers.get(name) or _answer(name, one, scenario) for name, one in asked)
    return Certificates(scenario.name, tuple(found))


def _answer(name: str, certificate: Callable[[Scenario], Verdict], scenario: Scenario) -> Verdict:
    """Its verdict; where it refuses the scenario, its reason, which the other certificates are no part of."""
    try:
        return certificate(scenario)
    except DefinitionError as error:
        refused = Assumption(str(error), "fails")
        return Verdict(name, name.replace("_", " "), False, None, {}, (refused,), f"Not certified: {error}.")
