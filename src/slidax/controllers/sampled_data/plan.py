"""The plan of one horizon: which velocity error leads from here to a place inside the envelope."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._types import Scalar, Vector
from slidax.numerics import increasing_root
from slidax.surfaces import AbstractSurface
from slidax.transformations import Frame

PRECISION = 1e-12
"""To what residual in the velocity error, rad/s or m/s, the plan is solved; rounding may leave some more."""

ROUNDING = 4e-16
"""Of a sum, relative to its largest term."""


class Barrier(eqx.Module):
    """`f(ε) = now ψ(ε) + H pull(ε)`, which increases from -∞ to ∞: for every y and s⁺ one ε has `f(ε) = y + H s⁺`.

    - `frame`: `now`, ψ.
    - `surface`: the pull.
    - `horizon`: H [s].
    """

    frame: Frame
    surface: AbstractSurface
    horizon: Scalar

    def value_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """`f(ε)` and its derivative, [n].

        - `eps`: transformed error [n].
        """
        place, place_slope = self.frame.place_and_slope(eps)
        pull, pull_slope = self.surface.pull_and_slope(eps)
        now, horizon = self.frame.now, self.horizon
        return now * place + horizon * pull, now * place_slope + horizon * pull_slope

    def solve(self, target: Vector, guess: Vector, at_guess: tuple[Vector, Vector]) -> Vector:
        """The ε with `f(ε) = target`, [n].

        - `target`: y + H s⁺, [n], rad or m.
        - `guess`: where to begin, [n].
        - `at_guess`: value and slope there.
        """
        size = jnp.abs(target)
        # The pull alone reaches the target there, and both parts have its sign.
        far = 1.0 + self.surface.reach(size / self.horizon)
        bracket = (jnp.where(target < 0, -far, -1.0), jnp.where(target > 0, far, 1.0))
        tolerance = PRECISION * self.horizon + ROUNDING * size
        return increasing_root(_value_and_slope, self, target, guess, at_guess, bracket, tolerance)


def _value_and_slope(barrier: Barrier, eps: Vector) -> tuple[Vector, Vector]:
    return barrier.value_and_slope(eps)
