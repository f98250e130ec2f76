"""How a run ended."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from slidax._names import joint_called
from slidax._types import Envelope, Scalar, Vector

from .excursion import Excursion

OutcomeKind = Literal["ok", "left_envelope", "not_finite", "recovered"]
FAULTS: tuple[OutcomeKind, ...] = ("ok", "left_envelope", "not_finite")
"""What the number in `Fault.kind` means."""
REMEDY = "Start inside it, enlarge its final radius, or shorten the period."


@dataclass(frozen=True)
class Outcome:
    """How a run ended, for a person and for a program.

    - `kind`: "ok", "left_envelope", "not_finite", or "recovered" for a run that was outside and came back.
    - `message`: one sentence, with the remedy.
    - `t`: when [s]; None if ok, as all that follow.
    - `joint`: which joint, counted from 1.
    - `error`, `bound`: the error there and the bound that it met, rad or m; None unless it left the envelope.
    - `back`: from when on it was inside to the end [s]; None unless it went on outside and came back.
    - `beyond`: by how much it was outside at the worst, rad or m; None unless it went on outside.
    """

    kind: OutcomeKind
    message: str
    t: float | None = None
    joint: int | None = None
    error: float | None = None
    bound: float | None = None
    back: float | None = None
    beyond: float | None = None

    @property
    def ok(self) -> bool:
        """True if the run reached its end inside the envelope."""
        return self.kind == "ok"

    @property
    def stopped(self) -> dict[str, str | float | int | None] | None:
        """All but the kind, by name, as results in JSON have it; None if ok."""
        return None if self.ok else {key: value for key, value in asdict(self).items() if key != "kind"}


class Fault(eqx.Module):
    """The first thing that went wrong, as arrays: `kind` indexes `FAULTS`, `joint` counts from 0."""

    kind: Int[Array, ""]
    t: Scalar
    joint: Int[Array, ""]
    error: Scalar
    bound: Scalar

    @property
    def absent(self) -> Bool[Array, "..."]:
        """True as long as nothing went wrong."""
        return self.kind == 0


def no_fault() -> Fault:
    """The fault of a run in which nothing went wrong."""
    zero = jnp.zeros(())
    return Fault(kind=jnp.zeros((), int), t=zero, joint=jnp.zeros((), int), error=zero, bound=zero)


def earlier(first: Fault, second: Fault) -> Fault:
    """The first fault if there is one, else the second.

    - `first`, `second`: in the order of time.
    """
    return jax.tree.map(lambda a, b: jnp.where(first.absent, b, a), first, second)


def find_fault(t: Scalar, e: Vector, finite: Bool[Array, " n"], envelope: Envelope | None) -> Fault:
    """What is wrong at one evaluation of the law, if anything is.

    - `t`: time [s].
    - `e`: error [n].
    - `finite`: per joint, whether state and torque are finite.
    - `envelope`: the bounds, or None.

    A joint at or outside its bounds comes first: what the law returns there has no meaning.
    """
    known = jnp.isfinite(e)
    lower, upper = (-jnp.inf, jnp.inf) if envelope is None else (envelope.lower, envelope.upper)
    outside = known & ((e <= lower) | (e >= upper)) if envelope is not None else jnp.zeros_like(finite)
    left = jnp.any(outside)
    broken = jnp.any(~(finite & known))
    joint = jnp.where(left, jnp.argmax(outside), jnp.argmax(~(finite & known)))
    error = jnp.where(left, e[joint], 0.0)
    bound = jnp.where(left, jnp.where(e <= lower, lower, upper)[joint], 0.0)
    kind = jnp.where(left, 1, jnp.where(broken, 2, 0))
    return Fault(kind=kind, t=t, joint=joint, error=error, bound=bound)


def describe(
    fault: Fault,
    excursion: Excursion | None,
    violations: int,
    period: float,
    units: tuple[str, ...],
    names: tuple[str, ...],
) -> Outcome:
    """The outcome in words.

    - `fault`: with known values.
    - `excursion`: where the run was outside its envelope, if it went on there.
    - `violations`: how many samples were outside.
    - `period`: time between samples [s].
    - `units`, `names`: the unit of each joint's position, and its name.
    """
    kind = FAULTS[int(fault.kind)]
    if kind == "ok":
        if excursion is not None and int(excursion.first) >= 0:
            return _described_excursion(excursion, violations, period, units, names)
        return Outcome("ok", "The run reached its end.")
    t, joint = float(fault.t), int(fault.joint)
    if kind == "not_finite":
        remedy = (
            "It was outside its envelope, where the law is not defined: use its sampled-data form."
            if excursion is not None and bool(excursion.outside)
            else "Shorten the period, or lower the gains; the run up to there is kept."
        )
        return Outcome(
            kind, f"{_joint(names[joint])} became infinite or undefined at t = {t:.4g} s. {remedy}", t, joint + 1
        )
    error, bound = float(fault.error), float(fault.bound)
    message = f"{_met(names[joint], _left(t), error, bound, units[joint])}. {REMEDY}"
    return Outcome(kind, message, t, joint + 1, error, bound)


def _left(t: float) -> str:
    return f"left its envelope at t = {t:.4g} s"


def _joint(name: str) -> str:
    """At the beginning of a sentence."""
    called = joint_called(name)
    return called[0].upper() + called[1:]


def _met(name: str, how: str, error: float, bound: float, unit: str) -> str:
    return f"{_joint(name)} {how} (e = {error:.4g} {unit}, bound {bound:.4g} {unit})"


def _described_excursion(
    excursion: Excursion, violations: int, period: float, units: tuple[str, ...], names: tuple[str, ...]
) -> Outcome:
    joint, error, bound = int(excursion.joint), float(excursion.error), float(excursion.bound)
    t, back = int(excursion.first) * period, (int(excursion.last) + 1) * period
    worst = int(np.argmax(excursion.beyond))
    beyond = float(excursion.beyond[worst])
    how = "was outside its envelope from the start" if int(excursion.first) == 0 else _left(t)
    first = _met(names[joint], how, error, bound, units[joint])
    outside = "1 sample was outside" if violations == 1 else f"{violations} samples were outside"
    extent = f"{outside}, by at most {beyond:.3g} {units[worst]} ({joint_called(names[worst])})"
    if bool(excursion.outside):
        message = f"{first} and is outside at the end: {extent}. Allow more torque, or shorten the period."
        return Outcome("left_envelope", message, t, joint + 1, error, bound, beyond=beyond)
    message = f"{first}, and was back for good at t = {back:.4g} s: {extent}."
    return Outcome("recovered", message, t, joint + 1, error, bound, back, beyond)
