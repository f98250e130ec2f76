"""Deviation of the members' plan targets from the nominal run's plan."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from slidax.controllers.steps.plan import Barrier
from slidax.surfaces import AbstractSurface
from slidax.transformations import Frame, Sides

SIGN = (-1.0, 1.0)


def aimed_beside(
    surface: AbstractSurface, sides: Sides, radius: Any, horizon: Any, ideal: tuple[Any, Any], target: Any, guess: Any
) -> tuple[Any, Any, Any]:
    """Return bounds of the change of ψ(ε) and φ(ε) when the plan's equation is solved for another target; in size.

    `N ψ(ε) + H φ(ε) = x` for `|x - x_b|` within a bound; ψ and φ increase with x, so its ends suffice.

    - `radius`: N [n].
    - `horizon`: H [s].
    - `ideal`: x_b and its ε [n].
    - `target`: bounds of `x - x_b` below and above, in size [2 n j].
    - `guess`: ε of the sample before [2 n j].

    Returns these for below and above [2 n j], and ε at the two ends [2 n j].
    """
    middle, eps_middle = ideal
    frame = Frame(now=radius, ahead=radius, sides=sides)
    barrier = Barrier(frame, surface, horizon)
    sign = jnp.asarray(SIGN)[:, None, None]
    # Further out by more than the equation is solved to, here and for the ideal arm.
    reach = target * (1.0 + 1e-12) + 4e-12 * (horizon + jnp.abs(middle)[:, None])
    signed = middle[:, None] + sign * reach

    def solve(target: Any, guess: Any) -> Any:
        return barrier.solve(target, guess, barrier.value_and_slope(guess))

    each = jax.vmap(jax.vmap(solve, in_axes=1, out_axes=1))
    eps = each(signed, guess)
    there = jax.vmap(jax.vmap(lambda value: frame.place_and_slope(value)[0], in_axes=1, out_axes=1))(eps)
    place = jnp.maximum(sign * (there - frame.place_and_slope(eps_middle)[0][:, None]), 0.0)
    pull = jnp.maximum(reach - radius[:, None] * place, 0.0) / horizon
    return place, pull, eps
