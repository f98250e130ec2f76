"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax._types import Envelope, Scalar, Vector

Kind = Literal["ok", "left_envelope", "not_finite"]
KINDS: tuple[Kind, ...] = ("ok", "left_envelope", "not_finite")


@dataclass(frozen=True)
class Outcome:
    """How a run ended, for a person and for a program.

    - `kind`: "ok", "left_envelope" or "not_finite".
    - `message`: one sentence, with the remedy.
    - `t`: when [s]; None if ok, as all that follow.
    - `joint`: which joint, counted from 1.
    - `error`, `bound`: the error there and the bound that it met, rad or m; None unless it left the envelope.
    """

    kind: Kind
    message: str
    t: float | None = None
    joint: int | None = None
    error: float | None = None
    bound: float | None = None

    @property
    def ok(self) -> bool:
        """True if the run reached its end inside the envelope."""
        return self.kind == "ok"


class Fault(eqx.Module):
    """The first thing that went wrong, as arrays: `kind` indexes `KINDS`, `joint` counts from 0."""

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
    kept: Fault = jax.tree.map(lambda a, b: jnp.where(first.absent, b, a), first, second)
    return kept


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


def describe(fault: Fault, units: tuple[str, ...]) -> Outcome:
    """The outcome in words.

    - `fault`: with known values.
    - `units`: the unit of each joint's position.
    """
    kind = KINDS[int(fault.kind)]
    if kind == "ok":
        return Outcome("ok", "The run reached its end.")
    t, joint = float(fault.t), int(fault.joint)
    if kind == "not_finite":
        message = (
            f"Joint {joint + 1} became infinite or undefined at t = {t:.4g} s. "
            "Shorten the period, or lower the gains; the run up to there is kept."
        )
        return Outcome(kind, message, t, joint + 1)
    error, bound = float(fault.error), float(fault.bound)
    unit = units[joint]
    message = (
        f"Joint {joint + 1} left its envelope at t = {t:.4g} s (e = {error:.4g} {unit}, bound {bound:.4g} {unit}). "
        "Start inside it, enlarge its final radius, or shorten the period."
    )
    return Outcome(kind, message, t, joint + 1, error, bound)
