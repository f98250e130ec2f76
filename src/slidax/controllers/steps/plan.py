"""Plan of one horizon: the velocity error that leads to a point inside the envelope."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax.numerics import increasing_root
from slidax.parts import Scalar, Vector
from slidax.surfaces import AbstractSurface
from slidax.transformations import Frame

PRECISION = 1e-12
"""rad/s or m/s: residual of the plan in the velocity error, besides rounding."""

ROUNDING = 4e-16
"""Rounding error of a sum, relative to its largest term."""


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
        """Return `f(ε)` and its derivative, [n]."""
        place, place_slope = _place_and_slope(self.frame, eps)
        pull, pull_slope = _pull_and_slope(self.surface, eps)
        now, horizon = self.frame.now, self.horizon
        return now * place + horizon * pull, now * place_slope + horizon * pull_slope

    def solve(self, target: Vector, guess: Vector, at_guess: tuple[Vector, Vector]) -> Vector:
        """Return the ε with `f(ε) = target`, [n].

        - `target`: y + H s⁺, [n], rad or m.
        - `at_guess`: value and slope at the guess.
        """
        size = jnp.abs(target)
        # The pull alone reaches the target there, and both parts have its sign.
        far = 1.0 + self.surface.reach(size / self.horizon)
        bracket = (jnp.where(target < 0, -far, -1.0), jnp.where(target > 0, far, 1.0))
        tolerance = PRECISION * self.horizon + ROUNDING * size
        return increasing_root(_value_and_slope, self, target, guess, at_guess, bracket, tolerance)


class Plan(eqx.Module):
    """Start of a plan, with the surface at a guess of its end.

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
        """Return a plan with its surface evaluated at the guess `eps`."""
        frame, horizon = barrier.frame, barrier.horizon
        place, place_slope = _place_and_slope(frame, eps)
        pull, pull_slope = _pull_and_slope(barrier.surface, eps)
        value, slope = frame.now * place + horizon * pull, frame.now * place_slope + horizon * pull_slope
        return Plan(barrier, y, v, s, eps, place, place_slope, value, slope)

    def holding_acceleration(self) -> Vector:
        """Acceleration relative to the reference's that keeps s, by one Newton step: [n], rad/s² or m/s²."""
        horizon = self.barrier.horizon
        place = self.place + self.place_slope * (self.y + horizon * self.s - self.value) / self.slope
        return ((self.barrier.frame.ahead * place - self.y) / horizon - self.v) / horizon

    def towards(self, s_next: Vector) -> tuple[Vector, Vector]:
        """Return the ε at its end, [n], and the acceleration relative to the reference's, [n], rad/s² or m/s².

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
