"""Outcome of a run: its first fault and its samples outside the envelope."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from slidax.core.joint_names import joint_label
from slidax.core.types import Envelope, Scalar, Vector


class Excursion(eqx.Module):
    """Statistics of a run's samples at or outside the envelope's bounds, as arrays.

    - `first`, `last`: numbers of the first and the last sample outside; -1 if there is none.
    - `joint`: joint farthest outside at the first sample outside, counted from 0.
    - `error`, `bound`: this joint's error and the bound that it exceeds at that sample, rad or m.
    - `beyond`: each joint's largest distance outside [n], rad or m; 0 if always inside.
    - `outside`: True if the latest sample was outside.
    """

    first: Int[Array, ""]
    last: Int[Array, ""]
    joint: Int[Array, ""]
    error: Scalar
    bound: Scalar
    beyond: Vector
    outside: Bool[Array, ""]

    @staticmethod
    def none(joints: int) -> Excursion:
        """Return the excursion of a run that never left its envelope."""
        never, zero = jnp.full((), -1), jnp.zeros(())
        return Excursion(
            first=never,
            last=never,
            joint=jnp.zeros((), int),
            error=zero,
            bound=zero,
            beyond=jnp.zeros(joints),
            outside=jnp.zeros((), bool),
        )

    def add(self, k: Int[Array, ""], e: Vector, envelope: Envelope) -> Excursion:
        """Return the excursion with sample k, which has the error e [n], rad or m."""
        over = jnp.maximum(e - envelope.upper, envelope.lower - e)
        outside = jnp.any(over >= 0)
        joint = jnp.argmax(over)
        first = outside & (self.first < 0)
        bound = jnp.where(e >= envelope.upper, envelope.upper, envelope.lower)
        return Excursion(
            first=jnp.where(first, k, self.first),
            last=jnp.where(outside, k, self.last),
            joint=jnp.where(first, joint, self.joint),
            error=jnp.where(first, e[joint], self.error),
            bound=jnp.where(first, bound[joint], self.bound),
            beyond=jnp.maximum(self.beyond, over),
            outside=outside,
        )


OutcomeKind = Literal["ok", "left_envelope", "not_finite", "recovered"]
FAULTS: tuple[OutcomeKind, ...] = ("ok", "left_envelope", "not_finite")
"""Meanings of `Fault.kind`."""
REMEDY = "Start inside it, enlarge its final radius, or shorten the period."


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run, in words and as data.

    - `kind`: "ok", "left_envelope", "not_finite", or "recovered" for a run that left its envelope and returned.
    - `message`: the outcome in words, with the remedy.
    - `t`: time of the fault [s]. This and all fields below are None if ok.
    - `joint`: number of the joint with the fault, counted from 1.
    - `error`, `bound`: the joint's error and bound at the fault, rad or m; None unless it left its envelope.
    - `back`: time of the final return into the envelope [s]; None without a return.
    - `beyond`: largest distance outside, rad or m; None unless the run continued outside.
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
        """Fields of a bad outcome, except `kind`, for results in JSON; None if the outcome is ok."""
        return None if self.ok else {key: value for key, value in asdict(self).items() if key != "kind"}


class Fault(eqx.Module):
    """A run's first fault, as arrays: `kind` indexes `FAULTS`, `joint` counts from 0; other fields as in `Outcome`."""

    kind: Int[Array, ""]
    t: Scalar
    joint: Int[Array, ""]
    error: Scalar
    bound: Scalar

    @property
    def absent(self) -> Bool[Array, "..."]:
        """True if there is no fault."""
        return self.kind == 0


def no_fault() -> Fault:
    """Return a `Fault` that stands for no fault."""
    zero = jnp.zeros(())
    return Fault(kind=jnp.zeros((), int), t=zero, joint=jnp.zeros((), int), error=zero, bound=zero)


def first_fault(first: Fault, second: Fault) -> Fault:
    """Return `first` if it is a fault, else `second`."""
    return jax.tree.map(lambda a, b: jnp.where(first.absent, b, a), first, second)


def find_fault(t: Scalar, e: Vector, finite: Bool[Array, " n"], envelope: Envelope | None) -> Fault:
    """Return the fault at one evaluation of the law, if any.

    A joint at or outside its bounds takes precedence, since the law is undefined there.

    - `e`: error [n].
    - `finite`: True for joints with finite state and torque.
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


def describe_outcome(
    fault: Fault,
    excursion: Excursion | None,
    violations: int,
    period: float,
    units: tuple[str, ...],
    names: tuple[str, ...],
) -> Outcome:
    """Describe the outcome of a finished run.

    - `violations`: number of samples at or outside the bounds.
    - `period`: time between samples [s].
    - `units`: unit of each joint's position.
    - `names`: joint names.
    """
    kind = FAULTS[int(fault.kind)]
    if kind == "ok":
        if excursion is not None and int(excursion.first) >= 0:
            return _describe_excursion(excursion, violations, period, units, names)
        return Outcome("ok", "The run reached its end.")
    t, joint = float(fault.t), int(fault.joint)
    if kind == "not_finite":
        remedy = (
            "It was outside its envelope, where the law is not defined: use its sampled-data form."
            if excursion is not None and bool(excursion.outside)
            else "The law's torque is not a number at the start: check its `init`, divisions, roots and logarithms."
            if t == 0.0
            else "Shorten the period, or lower the gains; the run up to there is kept."
        )
        return Outcome(
            kind, f"{_joint(names[joint])} became infinite or undefined at t = {t:.4g} s. {remedy}", t, joint + 1
        )
    error, bound = float(fault.error), float(fault.bound)
    message = f"{_describe_exit(names[joint], _left(t), error, bound, units[joint])}. {REMEDY}"
    return Outcome(kind, message, t, joint + 1, error, bound)


def _left(t: float) -> str:
    return f"left its envelope at t = {t:.4g} s"


def _joint(name: str) -> str:
    """Joint label at the beginning of a sentence."""
    words = joint_label(name)
    return words[0].upper() + words[1:]


def _describe_exit(name: str, event: str, error: float, bound: float, unit: str) -> str:
    return f"{_joint(name)} {event} (e = {error:.4g} {unit}, bound {bound:.4g} {unit})"


def _describe_excursion(
    excursion: Excursion, violations: int, period: float, units: tuple[str, ...], names: tuple[str, ...]
) -> Outcome:
    joint, error, bound = int(excursion.joint), float(excursion.error), float(excursion.bound)
    t, back = int(excursion.first) * period, (int(excursion.last) + 1) * period
    worst = int(np.argmax(excursion.beyond))
    beyond = float(excursion.beyond[worst])
    event = "was outside its envelope from the start" if int(excursion.first) == 0 else _left(t)
    first = _describe_exit(names[joint], event, error, bound, units[joint])
    outside = "1 sample was outside" if violations == 1 else f"{violations} samples were outside"
    extent = f"{outside}, by at most {beyond:.3g} {units[worst]} ({joint_label(names[worst])})"
    if bool(excursion.outside):
        message = f"{first} and is outside at the end: {extent}."
        return Outcome("left_envelope", message, t, joint + 1, error, bound, beyond=beyond)
    message = f"{first}, and was back for good at t = {back:.4g} s: {extent}."
    return Outcome("recovered", message, t, joint + 1, error, bound, back, beyond)
