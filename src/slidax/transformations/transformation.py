"""Base class of the error transformations."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx

from slidax._types import Envelope
from slidax.parts import AbstractPart, Memory, PerJoint, Scalar, Vector

from .frame import Frame


class TransformedError(eqx.Module):
    """The error as a surface sees it, `ε̇1 = ε2 = B (ė + A e)`, eqs. (25)-(28). All [n].

    - `eps1`: transformed error ε1.
    - `eps2`: its rate ε2, 1/s.
    - `beta`: diagonal of B, 1/rad.
    - `alpha`: diagonal of A, 1/s.
    - `alpha_rate`: diagonal of Ȧ, 1/s².
    """

    eps1: Vector
    eps2: Vector
    beta: Vector
    alpha: PerJoint
    alpha_rate: PerJoint


class AbstractTransformation(AbstractPart):
    """A map from error and time to the transformed error, fixed by the error at the start."""

    @abstractmethod
    def init(self, t: Scalar, e: Vector) -> Memory:
        """State of the transformation, from the error at the start: any pytree.

        - `t`: time at the start [s].
        - `e`: error at the start [n].
        """

    @abstractmethod
    def __call__(self, t: Scalar, e: Vector, de: Vector, memory: Memory) -> TransformedError:
        """The transformed error.

        - `t`: time [s].
        - `e`, `de`: error and its rate [n].
        - `memory`: what `init` returned.
        """

    @abstractmethod
    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The bounds that the error must keep, or None if there are none.

        - `t`: time [s].
        - `memory`: what `init` returned.
        """

    @abstractmethod
    def frame(self, t: Scalar, lead: Scalar, horizon: Scalar, memory: Memory) -> Frame:
        """Interval of the led error `y = e + c ė`, now and one horizon later, for a law that plans in discrete time.

        - `t`: time [s].
        - `lead`: c [s].
        - `horizon`: H [s].
        - `memory`: what `init` returned.
        """
