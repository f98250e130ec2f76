"""What every sliding surface is."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx

from slidax._types import Vector


class AbstractSurface(eqx.Module):
    """The part of a surface that acts on the transformed error: `s = B⁻¹ ε2 + pull(ε1)`, eq. (40)."""

    @abstractmethod
    def pull(self, eps: Vector) -> Vector:
        """How hard the surface pulls an error back, [n], rad/s or m/s: odd and increasing, per joint.

        - `eps`: transformed error ε1 [n].
        """

    @abstractmethod
    def slope(self, eps: Vector) -> Vector:
        """The derivative of `pull`, [n], >= 0.

        - `eps`: transformed error ε1 [n].
        """
