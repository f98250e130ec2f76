"""Variables of an FMU: each number of the step with name, unit, range and start."""

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
"""Stands for infinity, which some importers cannot read; the step treats larger values as infinite."""

UNDECLARED = {"period": "s", "horizon": "s"}
SIGNALS = {
    "s": ("sliding variable", "rad/s or m/s"),
    "s_next": ("sliding variable planned for the next sample", "rad/s or m/s"),
    "eps1": ("transformed error", ""),
    "eps2": ("rate of the transformed error", "1/s"),
    "rho": ("radius of the envelope as prescribed", "rad or m"),
    "u": ("magnitude of the robust part", ""),
    "margin": ("remaining margin of the guarantee; below 0 where it is void", ""),
    "push": ("estimated acceleration that the nominal model does not explain", "rad/s² or m/s²"),
    "residual": ("acceleration error of the last plan", "rad/s² or m/s²"),
    "rotor": ("learned rotor inertia", "kg m² or kg"),
    "coulomb": ("learned Coulomb friction", "N m or N"),
    "rejected": ("1 for a measurement that the gate rejected", ""),
    "reseated": ("1 where the envelope in force is wider than prescribed", ""),
    "assumption_violated": ("1 where the monitor reports a violated assumption of the guarantee", ""),
    "e": ("error of position", "rad or m"),
    "de": ("error of velocity", "rad/s or m/s"),
}
UNIT_SUFFIX = re.compile(r" \[[^]]*\](?=;|$)")
PLAIN = {"eps1": ("error", "rad or m"), "eps2": ("rate of the error", "rad/s or m/s")}
"""Their meanings without an error transformation."""

RATES = {"q": "", "dq": "/s", "ddq": "/s²"}


@dataclass(frozen=True)
class Variable:
    """One variable.

    - `name`: structured: `reference.dq_next[2]`.
    - `kind`: "real", "integer" or "boolean".
    - `causality`: "parameter", "input", "output" or "independent".
    - `place`: its C expression in the instance.
    - `lower`, `upper`: of its range; infinite where there is none.
    - `open`: True for a bound that is excluded.
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


def variables(exported: Project, *, with_envelope: bool) -> list[Variable]:
    """All variables; the index in the list is the value reference."""
    turns = [joint.q == "rad" for joint in exported.joints]
    second = unit("s")
    listed = [Variable("time", "real", "independent", "now", "time of the importer", second)]
    for structure, members in (("measurement", exported.measurement[1:]), ("reference", exported.reference)):
        for member in members:
            words = f"rad{RATES[member.name.removesuffix('_next')]} or m{RATES[member.name.removesuffix('_next')]}"
            listed += _numbers(structure, member, "input", words, turns, member.meaning)
    listed.append(
        Variable("restart", "boolean", "input", "restart", "true at a sample: the law is reset and starts again")
    )
    for member in exported.outputs:
        if member.name == "tau":
            listed += _numbers("command", member, "output", "N m or N", turns, "torque to hold until the next sample")
        else:
            known = SIGNALS if with_envelope else SIGNALS | PLAIN
            meaning, words = known.get(member.name, ("signal of the law", ""))
            listed += _numbers("command", member, "output", words, turns, meaning)
    if with_envelope:
        for member in envelope_members(len(turns)):
            words = "" if member.name == "margin" else "rad or m"
            listed += _numbers("envelope", member, "output", words, turns, member.meaning)
    listed.append(Variable("command.status", "integer", "output", "status", "bits of the status; 0 if all is well"))
    listed += [_flag(condition) for condition in exported.conditions]
    listed.append(Variable("status.held", "boolean", "output", f"bits[{len(exported.conditions)}]",
                          f"true if the torque is the last safe one: any bit of {HELD}"))  # fmt: skip
    for member, parameter in zip(exported.parameters, _declared(exported.guard), strict=True):
        listed += _parameters(member, parameter, turns)
    return listed


def _flag(condition: Condition) -> Variable:
    place = f"bits[{condition.bit.bit_length() - 1}]"
    text = f"{condition.meaning.replace('`', '')}. {condition.remedy.replace('`', '')}"
    return Variable(f"status.{condition.name.lower()}", "boolean", "output", place, text)


def _parameters(member: Member, parameter: Parameter, turns: list[bool]) -> Iterator[Variable]:
    assert member.values is not None
    lower, upper = parameter.range.ends
    ends = [end.number if end.number is not None and math.isfinite(end.number) else None for end in (lower, upper)]
    kind = {"f64": "real", "b1": "boolean"}.get(member.type, "integer")
    words = parameter.unit or UNDECLARED.get(member.name, "")
    endless = "; 1e300 for no limit" if upper.number == math.inf and not upper.open else ""
    meaning = f"{member.meaning}{endless}".replace("infinite for no limit; 1e300", "1e300")
    for k, variable in enumerate(_numbers("parameters", member, "parameter", words, turns, meaning)):
        yield replace(
            variable,
            kind=kind,
            start=float(np.clip(member.values.ravel()[k], -NO_LIMIT, NO_LIMIT)),
            lower=-math.inf if ends[0] is None else ends[0],
            upper=math.inf if ends[1] is None else ends[1],
            open=(lower.open, upper.open),
        )


def _numbers(
    structure: str, member: Member, causality: str, words: str, turns: list[bool], meaning: str
) -> Iterator[Variable]:
    """A variable for each number of a member; joints are counted from 1, as everywhere in FMI."""
    for k, index in enumerate(np.ndindex(member.shape)):
        label = f"[{','.join(str(i + 1) for i in index)}]" if member.shape else ""
        # A per-joint value has its joint's unit, any other value the unit shared by all joints.
        of_joint = member.shape[-1:] == (len(turns),) and len(member.shape) == 1
        kind = turns[index[-1]] if of_joint else (turns[0] if len(set(turns)) == 1 else None)
        yield Variable(
            f"{structure}.{member.name}{label}",
            "real",
            causality,
            f"{structure}.{member.element(k)}",
            UNIT_SUFFIX.sub("", meaning),
            unit(words, revolute=kind),
        )


def _declared(guard: GuardedStep) -> list[Parameter]:
    """Declaration of every parameter, in the order of the members: that of the innermost field on its way."""
    declarations = []
    for path, _ in jax.tree_util.tree_leaves_with_path(guard):
        declaration, place = Parameter("", ""), guard
        for key in path:
            name = getattr(key, "name", None)
            if name is not None:
                fields = {each.name: each for each in parameters_of(type(place))}
                declaration = fields.get(name, declaration)
            place = _child(place, key)
        declarations.append(declaration)
    return declarations


def _child(place: Any, key: Any) -> Any:
    if hasattr(key, "name"):
        return getattr(place, key.name)
    return place[getattr(key, "key", getattr(key, "idx", None))]
