"""The plan of one horizon: which velocity error leads from here to a place inside the envelope."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax.numerics import increasing_root
from slidax.parts import Scalar, Vector
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
        place, place_slope = _place_and_slope(self.frame, eps)
        pull, pull_slope = _pull_and_slope(self.surface, eps)
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


class Plan(eqx.Module):
    """Where a plan begins, with the surface at a guess of where it leads.

    - `barrier`: the equation of the plan.
    - `y`: led error [n], rad or m.
    - `v`: velocity error [n], rad/s or m/s.
    - `s`: sliding variable [n], rad/s or m/s.
    - `eps`: the guess, a transformed error [n].
    - `place`, `place_slope`: ψ there and its derivative [n].
    - `value`, `slope`: f there and its derivative [n].
    """

    barrier: Barrier
    y: Vector
    v: Vector
    s: Vector
    eps: Vector
    place: Vector
    place_slope: Vector
    value: Vector
    slope: Vector

    @staticmethod
    def near(barrier: Barrier, y: Vector, v: Vector, s: Vector, eps: Vector) -> Plan:
        """A plan that may lead near a given ε.

        - `barrier`, `y`, `v`, `s`, `eps`: as in the class.
        """
        frame, horizon = barrier.frame, barrier.horizon
        place, place_slope = _place_and_slope(frame, eps)
        pull, pull_slope = _pull_and_slope(barrier.surface, eps)
        value, slope = frame.now * place + horizon * pull, frame.now * place_slope + horizon * pull_slope
        return Plan(barrier, y, v, s, eps, place, place_slope, value, slope)

    def keeping(self) -> Vector:
        """The acceleration beyond the reference's that keeps s as it is, by one Newton step: [n], rad/s² or m/s²."""
        horizon = self.barrier.horizon
        place = self.place + self.place_slope * (self.y + horizon * self.s - self.value) / self.slope
        return ((self.barrier.frame.ahead * place - self.y) / horizon - self.v) / horizon

    def towards(self, s_next: Vector) -> tuple[Vector, Vector]:
        """The ε that it leads to, [n], and the acceleration beyond the reference's, [n], rad/s² or m/s².

        - `s_next`: the sliding variable s⁺ at its end [n], rad/s or m/s.
        """
        frame, horizon = self.barrier.frame, self.barrier.horizon
        eps = self.barrier.solve(self.y + horizon * s_next, self.eps, (self.value, self.slope))
        v_next = (frame.ahead * _place_and_slope(frame, eps)[0] - self.y) / horizon
        return eps, (v_next - self.v) / horizon


# Traced once, and functions in exported C.
@jax.jit
def _place_and_slope(frame: Frame, eps: Vector) -> tuple[Vector, Vector]:
    return frame.place_and_slope(eps)


@jax.jit
def _pull_and_slope(surface: AbstractSurface, eps: Vector) -> tuple[Vector, Vector]:
    return surface.pull_and_slope(eps)


def _value_and_slope(barrier: Barrier, eps: Vector) -> tuple[Vector, Vector]:
    return barrier.value_and_slope(eps)
