"""What an importer of the FMU sees: each number of the step as a variable with name, unit, range and start."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np

from slidax.parts import Parameter, parameters_of

from ..contents import Project
from ..envelope import envelope_members
from ..guarded_step import GuardedStep
from ..members import Member
from ..status import HELD, Condition
from .units import Unit, unit

NO_LIMIT = 1e300
"""Stands for infinity, which not every importer reads: what is at least as large is infinite in the step."""

UNDECLARED = {"period": "s", "horizon": "s"}
SIGNALS = {
    "s": ("sliding variable", "rad/s or m/s"),
    "s_next": ("sliding variable that is planned for the next sample", "rad/s or m/s"),
    "eps1": ("transformed error", ""),
    "eps2": ("rate of the transformed error", "1/s"),
    "rho": ("radius of the envelope as it was drawn", "rad or m"),
    "u": ("size of the robust part", ""),
    "margin": ("what is left of the room that the promise leaves; below 0 where it is void", ""),
    "push": ("estimated acceleration that the nominal model does not explain", "rad/s² or m/s²"),
    "residual": ("acceleration that the last plan missed", "rad/s² or m/s²"),
    "rotor": ("rotor inertia that was learnt", "kg m² or kg"),
    "coulomb": ("Coulomb friction that was learnt", "N m or N"),
    "rejected": ("1 for a measurement that the gate rejected", ""),
    "reseated": ("1 where the envelope in force is wider than it was drawn", ""),
    "assumption_violated": ("1 where the monitor says that what the promise was computed for is not so", ""),
    "e": ("error of position", "rad or m"),
    "de": ("error of velocity", "rad/s or m/s"),
}
UNIT_SAID = re.compile(r" \[[^]]*\](?=;|$)")
PLAIN = {"eps1": ("error", "rad or m"), "eps2": ("rate of the error", "rad/s or m/s")}
"""What they are without an envelope to transform by."""

RATES = {"q": "", "dq": "/s", "ddq": "/s²"}


@dataclass(frozen=True)
class Variable:
    """One number.

    - `name`: structured: `reference.dq_next[2]`.
    - `kind`: "real", "integer" or "boolean".
    - `causality`: "parameter", "input", "output" or "independent".
    - `place`: where it is in the instance, in C.
    - `description`: its meaning.
    - `unit`: None if it has none.
    - `start`: at the beginning.
    - `lower`, `upper`: the ends of its range; infinite where there is none.
    - `open`: which of the ends are outside of it.
    """

    name: str
    kind: str
    causality: str
    place: str
    description: str
    unit: Unit | None = None
    start: float = 0.0
    lower: float = -math.inf
    upper: float = math.inf
    open: tuple[bool, bool] = (False, False)


def variables(made: Project, *, with_envelope: bool) -> list[Variable]:
    """All variables; the place in the list is the value reference.

    - `made`: the step.
    - `with_envelope`: whether the law has an envelope.
    """
    turns = [joint.q == "rad" for joint in made.joints]
    second = unit("s")
    found = [Variable("time", "real", "independent", "now", "time of the importer", second)]
    for structure, members in (("measurement", made.measurement[1:]), ("reference", made.reference)):
        for member in members:
            words = f"rad{RATES[member.name.removesuffix('_next')]} or m{RATES[member.name.removesuffix('_next')]}"
            found += _numbers(structure, member, "input", words, turns, member.meaning)
    found.append(
        Variable("restart", "boolean", "input", "restart", "true at a sample: the law forgets all and starts anew")
    )
    for member in made.outputs:
        if member.name == "tau":
            found += _numbers("command", member, "output", "N m or N", turns, "torque to hold until the next sample")
        else:
            known = SIGNALS if with_envelope else SIGNALS | PLAIN
            meaning, words = known.get(member.name, ("signal of the law", ""))
            found += _numbers("command", member, "output", words, turns, meaning)
    if with_envelope:
        for member in envelope_members(len(turns)):
            words = "" if member.name == "margin" else "rad or m"
            found += _numbers("envelope", member, "output", words, turns, member.meaning)
    found.append(Variable("command.status", "integer", "output", "status", "bits of the status; 0 if all is well"))
    found += [_flag(condition) for condition in made.conditions]
    found.append(Variable("status.held", "boolean", "output", f"bits[{len(made.conditions)}]",
                          f"whether the torque is the last safe one: any bit of {HELD}"))  # fmt: skip
    for member, said in zip(made.parameters, _declared(made.guard), strict=True):
        found += _parameters(member, said, turns)
    return found


def _flag(condition: Condition) -> Variable:
    place = f"bits[{condition.bit.bit_length() - 1}]"
    said = f"{condition.meaning.replace('`', '')}. {condition.remedy.replace('`', '')}"
    return Variable(f"status.{condition.name.lower()}", "boolean", "output", place, said)


def _parameters(member: Member, said: Parameter, turns: list[bool]) -> Iterator[Variable]:
    assert member.values is not None
    lower, upper = said.range.ends
    ends = [end.number if end.number is not None and math.isfinite(end.number) else None for end in (lower, upper)]
    kind = {"f64": "real", "b1": "boolean"}.get(member.type, "integer")
    words = said.unit or UNDECLARED.get(member.name, "")
    endless = "; 1e300 for no limit" if upper.number == math.inf and not upper.open else ""
    meaning = f"{member.meaning}{endless}".replace("infinite for no limit; 1e300", "1e300")
    for k, one in enumerate(_numbers("parameters", member, "parameter", words, turns, meaning)):
        yield replace(
            one,
            kind=kind,
            start=float(np.clip(member.values.ravel()[k], -NO_LIMIT, NO_LIMIT)),
            lower=-math.inf if ends[0] is None else ends[0],
            upper=math.inf if ends[1] is None else ends[1],
            open=(lower.open, upper.open),
        )


def _numbers(
    structure: str, member: Member, causality: str, words: str, turns: list[bool], meaning: str
) -> Iterator[Variable]:
    """A variable for each number of a member, joints counted from 1 as everywhere in the importers."""
    for k, index in enumerate(np.ndindex(member.shape)):
        label = f"[{','.join(str(i + 1) for i in index)}]" if member.shape else ""
        # What has one number per joint takes the joint's unit, anything else the one that all joints share.
        of_joint = member.shape[-1:] == (len(turns),) and len(member.shape) == 1
        kind = turns[index[-1]] if of_joint else (turns[0] if len(set(turns)) == 1 else None)
        yield Variable(
            f"{structure}.{member.name}{label}",
            "real",
            causality,
            f"{structure}.{member.element(k)}",
            UNIT_SAID.sub("", meaning),
            unit(words, revolute=kind),
        )


def _declared(guard: GuardedStep) -> list[Parameter]:
    """The declaration of every parameter, in the order of the members: that of the innermost field on its way."""
    found = []
    for path, _ in jax.tree_util.tree_leaves_with_path(guard):
        said, place = Parameter("", ""), guard
        for key in path:
            name = getattr(key, "name", None)
            if name is not None:
                fields = {each.name: each for each in parameters_of(type(place))}
                said = fields.get(name, said)
            place = _child(place, key)
        found.append(said)
    return found


def _child(place: Any, key: Any) -> Any:
    if hasattr(key, "name"):
        return getattr(place, key.name)
    return place[getattr(key, "key", getattr(key, "idx", None))]
