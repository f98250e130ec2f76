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
"""Blocks of an uncertainty set that every certificate of an arm bounds or tests."""

WORLD = ("robot", "trajectory", "start", "disturbance", "actuator")
"""Blocks of a scenario that are no part of its law."""


@dataclass(frozen=True)
class Certificate(Generic[Options]):
    """A certificate, called like the function that computes its verdict: `admissibility(scenario)`.

    It does not apply to a scenario with an uncertain path that it does not cover.

    - `judge`: computes the verdict; its docstring states the guarantee.
    - `covers`: paths whose uncertainty it covers, with all paths below them; includes paths that do not matter for it.
    - `reads`: paths that the verdict depends on, with all paths below them; None for all.
    """

    name: str
    title: str
    judge: Callable[Concatenate[Scenario, Options], Verdict]
    covers: tuple[str, ...]
    reads: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.judge.__doc__)

    def __call__(self, scenario: Scenario, *args: Options.args, **kwargs: Options.kwargs) -> Verdict:
        """Return the verdict.

        Raises DefinitionError if JAX computes with 32 bits, or the scenario is invalid.
        """
        require_64_bits()
        other_sets = [value for value in (*args, *kwargs.values()) if isinstance(value, Family)]
        reason = self._uncovered(scenario, other_sets)
        if reason:
            return Verdict(self.name, self.title, None, None, {}, (), reason)
        return self.judge(scenario, *args, **kwargs)

    def may_read(self, path: str) -> bool:
        """Return True if the verdict may depend on the value at a path, written as for `--set`.

        A test changes all values of scenarios that a certificate does not read, and expects the same verdict.
        """
        return self.reads is None or any(_below(path, root) or root.startswith(f"{path}.") for root in self.reads)

    def _uncovered(self, scenario: Scenario, other_sets: Iterable[Family]) -> str:
        """Reason why the certificate does not apply, with the uncovered paths; empty if it applies."""
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
                return (
                    f"not applicable: `{block}` has {listed}, which this certificate does not cover; `statistical` "
                    "tests it, and without it in the file this certificate applies"
                )
        return ""


def _below(path: str, root: str) -> bool:
    return f"{path}.".startswith(f"{root}.")


def certificate(
    name: str, title: str, *, covers: tuple[str, ...], reads: tuple[str, ...] | None = None
) -> Callable[[Callable[Concatenate[Scenario, Options], Verdict]], Certificate[Options]]:
    """Decorate a function that computes a verdict, so that it becomes a `Certificate`."""
    return lambda judge: Certificate(name, title, judge, covers, reads)
