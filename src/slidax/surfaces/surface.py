"""Base class of the sliding surfaces."""

from __future__ import annotations

from abc import abstractmethod

from slidax.parts import AbstractPart, Vector


class AbstractSurface(AbstractPart):
    """The part of a surface that acts on the transformed error: `s = B⁻¹ ε2 + pull(ε1)`, eq. (40)."""

    @abstractmethod
    def pull_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """The pull towards zero error [n], rad/s or m/s, odd and increasing; and its derivative [n], >= 0.

        One method for both, since they share their powers.

        - `eps`: transformed error ε1 [n].
        """

    @abstractmethod
    def reach(self, pull: Vector) -> Vector:
        """A transformed error at which the pull is at least this strong, [n]: the end of a bracket.

        - `pull`: >= 0, [n], rad/s or m/s.
        """
