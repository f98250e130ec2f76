"""All certificates of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, wraps
from typing import Any

from slidax.core.errors import DefinitionError
from slidax.core.tracing import require_64_bits
from slidax.scenarios.scenario import Scenario

from .admissibility import admissibility
from .arm.demand import Demand, compute_demand
from .arm.inertia_ratio import inertia_ratio
from .arm.robust_torque import robust_torque, uncertainty_bound
from .arm.torque_budget import torque_budget
from .certificate import Assumption, Certificate, Verdict
from .motion.admission import tracking_bound
from .printed.settling_time import settling_time
from .printed.ultimate_bound import printed_period, ultimate_bound
from .statistical import RUNS, statistical
from .uncertainty_set import family_of


@lru_cache(maxsize=2)
def _demand(scenario: Scenario) -> Demand:
    return compute_demand(scenario)


def _with_demand(certificate: Certificate[...]) -> Certificate[...]:
    """Return the certificate with the scenario's `Demand` as its argument. The demand is computed once per scenario."""

    @wraps(certificate.judge)
    def judge(scenario: Scenario) -> Verdict:
        return certificate.judge(scenario, _demand(scenario))

    return replace(certificate, judge=judge)


CERTIFICATES: tuple[Certificate[...], ...] = (
    admissibility,
    _with_demand(inertia_ratio),
    tracking_bound,
    _with_demand(robust_torque),
    _with_demand(torque_budget),
    uncertainty_bound,
    printed_period,
    settling_time,
    ultimate_bound,
)
"""All certificates except the statistical one, in display order."""


@dataclass(frozen=True)
class Certificates:
    """All verdicts of a scenario, in display order.

        certified = slidax.certify.certify(scenario)
        certified.holds
        certified["tracking_bound"].bound

    - `scenario`: the scenario's name.
    """

    scenario: str
    verdicts: Sequence[Verdict]

    @property
    def holds(self) -> bool:
        """True if each certificate that applies holds."""
        return not self.failing

    @property
    def failing(self) -> list[str]:
        """Names of the certificates that do not hold."""
        return [verdict.name for verdict in self.verdicts if verdict.holds is False]

    @property
    def summary(self) -> str:
        """The verdict in a sentence: which certificates fail, or from when on all hold and the weakest grade."""
        if self.failing:
            return f"Not certified: {', '.join(self.failing)}."
        grades = [verdict.grade for verdict in self.verdicts if verdict.grade]
        weakest = f" Weakest grade: {max(grades)}." if grades else ""
        since = "" if self.since is None else f", from {self.since:.3g} s on"
        return f"Every guarantee that applies holds{since}.{weakest}"

    @property
    def since(self) -> float | None:
        """Time from which on all certificates hold [s]; None if they hold from the start."""
        return max((verdict.since for verdict in self.verdicts if verdict.since is not None), default=None)

    def __getitem__(self, name: str) -> Verdict:
        for verdict in self.verdicts:
            if verdict.name == name:
                return verdict
        raise KeyError(name)

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.verdicts)

    def as_json(self) -> dict[str, Any]:
        """Return the verdicts as `slidax certify --json` prints them."""
        return {"certificates": [verdict.as_json() for verdict in self.verdicts]}


def certify(
    scenario: Scenario,
    *,
    runs: int = RUNS,
    seed: int = 0,
    known: Sequence[Verdict] = (),
    begin: Callable[[str, int], None] = lambda name, total: None,
) -> Certificates:
    """Certify a scenario with its block `uncertainty`.

    - `runs`: number of runs of the statistical certificate; 0 leaves it out.
    - `seed`: seed of these runs.
    - `known`: verdicts of this scenario that were computed before; they are returned unchanged.
    - `begin`: called before each certificate that is computed, with its name and the number of all certificates.

    Raises DefinitionError if the scenario was changed in Python and no longer agrees with its description, if its block
    `uncertainty` is invalid, or if JAX computes with 32 bits.
    """
    require_64_bits()
    if scenario.changed:
        raise DefinitionError(
            f"`{scenario.name}` was changed by `replace` ({', '.join(scenario.changed)}): certify a scenario from "
            "`load` or `alter`"
        )
    # An empty set, or a path that does not exist, is an error of the scenario, not a failing verdict.
    family_of(scenario)
    judges: list[tuple[str, Callable[[Scenario], Verdict]]]
    judges = [(certificate.name, certificate) for certificate in CERTIFICATES]
    if runs:
        judges.append((statistical.__name__, lambda scenario: statistical(scenario, runs, seed)))
    verdicts = {verdict.name: verdict for verdict in known}
    for name, judge in judges:
        if name not in verdicts:
            begin(name, len(judges))
            verdicts[name] = _verdict(name, judge, scenario)
    return Certificates(scenario.name, tuple(verdicts[name] for name, _ in judges))


def _verdict(name: str, certificate: Callable[[Scenario], Verdict], scenario: Scenario) -> Verdict:
    """Return the verdict; if the certificate raises DefinitionError, a failing one with this reason."""
    try:
        return certificate(scenario)
    except DefinitionError as error:
        reason = Assumption(str(error), "fails")
        return Verdict(name, name.replace("_", " "), False, None, {}, (reason,), f"Not certified: {error}.")
