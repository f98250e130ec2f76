"""The plan's equation as a table: where a plan aims at most, rounded up."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.surfaces import AbstractSurface
from slidax.transformations import Sides
from slidax.transformations.psi import psi

Floats = NDArray[np.floating[Any]]

STEPS = 12
"""The table has 2^12 places."""

NEAREST, FARTHEST = 1e-12, 1e4
"""Transformed errors at the table's ends; from one to the next is a step of .9 %."""


def table_of(surface: AbstractSurface, sides: Sides) -> tuple[Floats, Floats]:
    """`|ψ(ε)|` and `|pull(ε)|` for ε below and above zero, ascending [2 n 4096].

    - `surface`, `sides`: of a law.
    """
    eps = jnp.geomspace(NEAREST, FARTHEST, 2**STEPS)
    sign = jnp.array([-1.0, 1.0])

    def at(one: Any) -> Any:
        signed = sign[:, None] * one
        place = jax.vmap(lambda e: psi(jnp.broadcast_to(e, sides.lower.shape), sides))(signed)
        pull = jax.vmap(lambda e: surface.pull_and_slope(jnp.broadcast_to(e, sides.lower.shape))[0])(signed)
        return jnp.abs(place), jnp.abs(pull)

    place, pull = (np.moveaxis(np.asarray(one), 0, -1) for one in jax.jit(jax.vmap(at))(eps))
    return np.maximum.accumulate(place, axis=-1), np.maximum.accumulate(pull, axis=-1)


def aimed_at_most(table: tuple[Any, Any], radius: Any, horizon: Any, target: Any) -> tuple[Any, Any]:
    """Bounds of `|ψ(ε)|` and `pull(|ε|)` where `N ψ(ε) + H pull(ε)` is no more than a target, each [2 n j].

    The first of the table's places that is not below it, since both parts increase.

    - `table`: of `table_of`.
    - `radius`: N [n].
    - `horizon`: H [s].
    - `target`: in size, below and above zero [2 n j].
    """
    place, pull = table
    # One row for each side and joint, so that a place is found by one index.
    width = place.shape[-1]
    row = width * jnp.arange(place.size // width).reshape(*place.shape[:-1], 1)
    flat_place, flat_pull = place.reshape(-1), pull.reshape(-1)
    found = jnp.zeros(target.shape, row.dtype)
    for k in reversed(range(STEPS)):
        at = row + found + (2**k - 1)
        value = radius[None, :, None] * flat_place[at] + horizon * flat_pull[at]
        found = jnp.where(value < target, found + 2**k, found)
    at = row + jnp.minimum(found, width - 1)
    return flat_place[at], flat_pull[at]
