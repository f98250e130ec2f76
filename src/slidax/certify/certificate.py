"""Certificates and their verdicts, each with its margin and its assumptions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Concatenate, Generic, Literal, ParamSpec, get_args

import numpy as np

from slidax.analysis.cause import Remedy
from slidax.core.files import json_value
from slidax.core.tracing import require_64_bits
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertainty import INERTIAL_PATH

from .uncertainty_set import family_of, to_canonical

Status = Literal["proved", "tested", "assumed", "fails"]
"""Status of an assumption.

- `proved`: follows from the definitions for the whole uncertainty set, up to floating-point rounding.
- `tested`: computed for finitely many members of the set, times or cases, which the text names.
- `assumed`: not checked.
- `fails`: violated.
"""

Grade = Literal["A", "B", "C"]
"""Grade of a verdict that holds: `A` if all assumptions are proved, `B` if some are, `C` if none is."""


@dataclass(frozen=True)
class Assumption:
    """An assumption of a guarantee.

    - `text`: the assumption as a sentence, with the tested cases if there are any.
    - `value`: a number computed for it, such as the ratio of a bound to its limit; None if there is none.
    """

    text: str
    status: Status
    value: float | None = None


@dataclass(frozen=True)
class Verdict:
    """Result of a certificate.

    - `title`: short form of the guarantee, for a table.
    - `holds`: None if the certificate does not apply; `statement` has the reason.
    - `margin`: distance to the allowed value, relative to it; >= 0 if the guarantee holds, None without such a value.
    - `bound`: bounds by name, scalars or one value per joint, in SI units.
    - `statement`: the guarantee as a sentence with units and equation.
    - `remedies`: proposed changes with which the guarantee may hold, best first; empty if it holds.
    - `since`: time from which the guarantee holds, s; None for the whole run, or if it does not hold.
    """

    name: str
    title: str
    holds: bool | None
    margin: float | None
    bound: Mapping[str, Any]
    assumptions: Sequence[Assumption]
    statement: str
    remedies: Sequence[Remedy] = field(default=())
    since: float | None = None

    def __post_init__(self) -> None:
        if self.holds and any(line.status == "fails" for line in self.assumptions):
            raise AssertionError(f"certificate `{self.name}` holds although one of its assumptions fails")

    @property
    def answer(self) -> str:
        """`yes`, `no`, `from 0.5 s` if the guarantee holds from a time on, or `-` if the certificate does not apply."""
        if self.holds and self.since is not None:
            return f"from {self.since:.3g} s"
        return "-" if self.holds is None else "yes" if self.holds else "no"

    @property
    def grade(self) -> Grade | None:
        """Grade by the proved assumptions: `A` if all are proved, `B` if some, `C` if none; None unless `holds`."""
        if not self.holds:
            return None
        proved = [line.status == "proved" for line in self.assumptions]
        return "C" if not any(proved) else "A" if all(proved) else "B"

    @property
    def stands_on(self) -> str:
        """Number of assumptions with each status, such as "2 proved, 3 tested, 1 assumed"."""
        statuses = [line.status for line in self.assumptions]
        return ", ".join(f"{statuses.count(status)} {status}" for status in get_args(Status) if status in statuses)

    def as_json(self) -> dict[str, Any]:
        """Return the verdict as `slidax certify --json` prints it; non-finite values are None."""
        return {
            "name": self.name,
            "holds": self.holds,
            "since": json_value(self.since),
            "grade": self.grade,
            "margin": json_value(self.margin),
            "bound": json_value(self.bound),
            "assumptions": [
                {"text": line.text, "status": line.status, "value": json_value(line.value)} for line in self.assumptions
            ],
            "statement": self.statement,
            "remedy": [{"words": remedy.words, "set": dict(remedy.changes)} for remedy in self.remedies],
        }


def joint_values(values: Any) -> str:
    """Format one number, or one per joint with commas if they differ: `1.2, 3.4, 5.6`."""
    words = [f"{float(value):.3g}" for value in np.atleast_1d(np.asarray(values, float))]
    return words[0] if len(set(words)) == 1 else ", ".join(words)


Options = ParamSpec("Options")

ARM = ("robot", "disturbance", "start")
"""Blocks of an uncertainty set that every certificate except `tracking_bound` and `statistical` covers.

The band of inertial parameters under `robot` counts only if a certificate names it.
"""

WORLD = ("robot", "trajectory", "start", "disturbance", "actuator")
"""Blocks of a scenario that define the controlled system and its motion, not the law."""


@dataclass(frozen=True)
class Certificate(Generic[Options]):
    """A certificate, called like the function that computes its verdict: `admissibility(scenario)`.

    Paths are dotted paths of the scenario file, such as `robot.plant.load`. Each stands for all paths below it, too.
    The certificate does not apply if the block `uncertainty` or `truth` has a path that `covers` does not contain.

    - `name`, `title`: the certificate's name in `certify`, and the short form of the guarantee.
    - `judge`: function that computes the verdict; its docstring states the guarantee.
    - `covers`: paths whose uncertainty the guarantee includes, or that do not affect the verdict.
    - `reads`: paths that the verdict depends on; None if it may depend on any.
    """

    name: str
    title: str
    judge: Callable[Concatenate[Scenario, Options], Verdict]
    covers: tuple[str, ...]
    reads: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.judge.__doc__)

    def __call__(self, scenario: Scenario, *args: Options.args, **kwargs: Options.kwargs) -> Verdict:
        """Return the verdict; further arguments are those of `judge`, such as another uncertainty set.

        Raises DefinitionError if JAX computes with 32 bits, or the scenario is invalid.
        """
        require_64_bits()
        other_sets = [value for value in (*args, *kwargs.values()) if isinstance(value, Family)]
        reason = self._uncovered(scenario, other_sets)
        if reason:
            return Verdict(self.name, self.title, None, None, {}, (), reason)
        return self.judge(scenario, *args, **kwargs)

    def may_read(self, path: str) -> bool:
        """Return True if the verdict may depend on the value at a dotted path, such as `robot.plant.load`.

        A test changes all values that a certificate does not read, and expects the same verdict.
        """
        return self.reads is None or any(_below(path, root) or root.startswith(f"{path}.") for root in self.reads)

    def _uncovered(self, scenario: Scenario, other_sets: Iterable[Family]) -> str:
        """Return the reason why the certificate does not apply, with the uncovered paths; empty if it applies."""
        if scenario.description.transmission is not None and self.may_read("transmission"):
            return (
                "not applicable: no certificate of an arm covers LuGre friction or elastic joints; `statistical` tests "
                "them, and without `transmission` in the file this certificate applies"
            )
        drives = scenario.description.actuator
        if drives.map or drives.true_map:
            return "not applicable: no certificate covers `actuator.map` or `actuator.true_map`; `statistical` does"
        own = family_of(scenario)
        families = [to_canonical(family) for family in other_sets] or ([] if own is None else [own])
        blocks = {
            "uncertainty": {path for family in families for path in family.space.sets},
            "truth": {path for family in families for path in family.base.truth} | set(scenario.description.truth),
        }
        for block, paths in blocks.items():
            outside = sorted(path for path in paths if not self._covers(path))
            if outside:
                listed = ", ".join(f"`{path}`" for path in outside)
                return (
                    f"not applicable: `{block}` has {listed}, which this certificate does not cover; `statistical` "
                    "tests it, and without it in the file this certificate applies"
                )
        return ""

    def _covers(self, path: str) -> bool:
        """Return True if a path is covered. The band of inertial parameters counts only if `covers` names it."""
        return INERTIAL_PATH in self.covers if path == INERTIAL_PATH else any(_below(path, r) for r in self.covers)


def _below(path: str, root: str) -> bool:
    return f"{path}.".startswith(f"{root}.")


def certificate(
    name: str, title: str, *, covers: tuple[str, ...], reads: tuple[str, ...] | None = None
) -> Callable[[Callable[Concatenate[Scenario, Options], Verdict]], Certificate[Options]]:
    """Return a decorator that makes a `Certificate` of a function that computes a verdict.

    - `name`, `title`, `covers`, `reads`: fields of the certificate.
    """
    return lambda judge: Certificate(name, title, judge, covers, reads)
