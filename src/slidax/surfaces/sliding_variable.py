"""The sliding variable, and the acceleration that keeps it constant."""

from __future__ import annotations

import equinox as eqx

from slidax._types import Reference
from slidax.numerics import once
from slidax.parts import Memory, Scalar, State, Vector
from slidax.transformations import AbstractTransformation, TransformedError

from .surface import AbstractSurface


class SlidingVariable(eqx.Module):
    """`s = ė + A e + pull(ε1)`, eq. (40), and the acceleration `q̈_d - Ȧ e - A ė - slope(ε1) ε2` that keeps it. All [n].

    - `s`: sliding variable, rad/s or m/s.
    - `error`: the transformed error.
    - `feedforward`: `q̈_d - Ȧ e - A ė`, the acceleration of the reference and the envelope, rad/s² or m/s².
    - `descent`: `slope(ε1) ε2`, the rate of the pull, rad/s² or m/s².
    """

    s: Vector
    error: TransformedError
    feedforward: Vector
    descent: Vector

    @property
    def equivalent(self) -> Vector:
        """The acceleration that keeps s constant, [n], rad/s² or m/s²."""
        return self.feedforward - self.descent

    @property
    def signals(self) -> dict[str, Vector]:
        """Logged quantities: `s`, `eps1`, `eps2`."""
        return {"s": self.s, "eps1": self.error.eps1, "eps2": self.error.eps2}


def sliding_variable(
    transformation: AbstractTransformation,
    surface: AbstractSurface,
    t: Scalar,
    state: State,
    reference: Reference,
    memory: Memory,
) -> SlidingVariable:
    """The sliding variable of a surface over a transformed error.

    - `transformation`: e to ε1, with A and B.
    - `surface`: the pull on ε1.
    - `t`: time [s].
    - `memory`: state of the transformation.
    """
    e, de = state.q - reference.q, state.dq - reference.dq
    error = once(transformation(t, e, de, memory))
    pull, slope = surface.pull_and_slope(error.eps1)
    return SlidingVariable(
        s=de + error.alpha * e + pull,
        error=error,
        feedforward=reference.ddq - error.alpha_rate * e - error.alpha * de,
        descent=slope * error.eps2,
    )
