"""Certificates as callables that declare the parts of a scenario that they cover and read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Concatenate, Generic, ParamSpec

from slidax.numerics import require_64_bits
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family

from .members import canonical, family_of
from .verdict import Verdict

Options = ParamSpec("Options")

ARM = ("robot", "disturbance", "start")
"""Blocks of which a set is bounded or tested by every certificate of an arm."""

WORLD = ("robot", "trajectory", "start", "disturbance", "actuator")
"""Blocks of a scenario that are no part of its law."""


@dataclass(frozen=True)
class Certificate(Generic[Options]):
    """A certificate, called like the function that computes its verdict: `admissibility(scenario)`.

    It is not applicable to a scenario with an uncertain path that it does not cover.

    - `name`, `title`: in tables and JSON.
    - `judge`: from a scenario to the verdict; its docstring says what is claimed.
    - `covers`: paths of which it covers any uncertain set, with all that is below them; those on which its claim does
      not depend are among them.
    - `reads`: paths on which its verdict depends, with all that is below them; None for all.
    """

    name: str
    title: str
    judge: Callable[Concatenate[Scenario, Options], Verdict]
    covers: tuple[str, ...]
    reads: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.judge.__doc__)

    def __call__(self, scenario: Scenario, *args: Options.args, **kwargs: Options.kwargs) -> Verdict:
        """The verdict.

        - `scenario`: with its blocks `uncertainty` and `truth`.

        Raises DefinitionError if JAX has 32-bit numbers, or the scenario is invalid.
        """
        require_64_bits()
        other_sets = [value for value in (*args, *kwargs.values()) if isinstance(value, Family)]
        reason = self._uncovered(scenario, other_sets)
        if reason:
            return Verdict(self.name, self.title, None, None, {}, (), reason)
        return self.judge(scenario, *args, **kwargs)

    def may_read(self, path: str) -> bool:
        """True if the verdict may depend on a number.

        A test moves all numbers of scenarios that a certificate does not read, and expects the same verdict.

        - `path`: of the number, as for `--set`.
        """
        return self.reads is None or any(_below(path, root) or root.startswith(f"{path}.") for root in self.reads)

    def _uncovered(self, scenario: Scenario, other_sets: Iterable[Family]) -> str:
        """The reason why it is not applicable, with the paths that it does not cover; empty if it is."""
        own = family_of(scenario)
        families = [canonical(family) for family in other_sets] or ([] if own is None else [own])
        places = {
            "uncertainty": {path for family in families for path in family.space.sets},
            "truth": {path for family in families for path in family.base.truth} | set(scenario.description.truth),
        }
        for block, paths in places.items():
            outside = sorted(path for path in paths if not any(_below(path, root) for root in self.covers))
            if outside:
                listed = ", ".join(f"`{path}`" for path in outside)
                remedy = "`statistical` tests it; without it in the file this certificate applies"
                return f"not applicable: `{block}` has {listed}, which this certificate does not cover; {remedy}"
        return ""


def _below(path: str, root: str) -> bool:
    return f"{path}.".startswith(f"{root}.")


def certificate(
    name: str, title: str, *, covers: tuple[str, ...], reads: tuple[str, ...] | None = None
) -> Callable[[Callable[Concatenate[Scenario, Options], Verdict]], Certificate[Options]]:
    """Make a certificate of the function below.

    - `name`, `title`, `covers`, `reads`: as in `Certificate`.
    """
    return lambda judge: Certificate(name, title, judge, covers, reads)
