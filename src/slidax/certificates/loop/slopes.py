"""Slope of the surface function over ψ, between any two transformed errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.surfaces import AbstractSurface
from slidax.transformations import Sides
from slidax.transformations.psi import psi_and_slope

from ..each import Floats

STEPS = 12
"""Each side of the table has 2^12 places."""

NEAREST, FARTHEST = 1e-12, 1e4
"""Transformed errors at the table's ends; neighbouring ones differ by 0.9 %."""


SLOPES = (1e-100, 1e100)
"""Limits of all slopes."""


@dataclass(frozen=True)
class Slopes:
    """dφ/dψ over ε, with the least and the largest of 2^l places from each one on, for each joint.

    - `eps`: ascending [M].
    - `least`, `most`: [l n M].
    """

    eps: Any
    least: Any
    most: Any

    @classmethod
    def of(cls, surface: AbstractSurface, sides: Sides) -> Slopes:
        """The table of a law."""
        size = np.geomspace(NEAREST, FARTHEST, 2**STEPS)
        eps = jnp.asarray(np.concatenate([-size[::-1], np.zeros(1), size]))
        slope = np.asarray(_slope(surface, sides, eps)).T
        # Between two places it is off them by no more than their own difference, wherever it turns.
        ratio = np.maximum(slope[:, 1:] / slope[:, :-1], slope[:, :-1] / slope[:, 1:])
        step = np.concatenate([ratio, ratio[:, -1:]], axis=1)
        step = np.maximum(step, np.concatenate([ratio[:, :1], ratio], axis=1))
        least, most = [slope / step], [slope * step]
        for level in range(STEPS + 1):
            span = 2**level
            least.append(np.minimum(least[-1], _later(least[-1], span)))
            most.append(np.maximum(most[-1], _later(most[-1], span)))
        return cls(eps, jnp.asarray(np.array(least)), jnp.asarray(np.array(most)))

    def between(self, low: Any, high: Any) -> tuple[Any, Any]:
        """The least and the largest slope for ε between two values [n], each [n].

        - `low`, `high`: ends, `low <= high` [n].
        """
        size = self.eps.shape[0]
        i = jnp.clip(jnp.searchsorted(self.eps, low, side="right") - 1, 0, size - 1)
        j = jnp.clip(jnp.searchsorted(self.eps, high, side="left"), i, size - 1)
        level = jnp.asarray(jnp.floor(jnp.log2((j - i + 1).astype(float)) + 1e-9), i.dtype)
        joint = jnp.arange(i.shape[0])
        second = j - 2**level + 1
        least = jnp.minimum(self.least[level, joint, i], self.least[level, joint, second])
        most = jnp.maximum(self.most[level, joint, i], self.most[level, joint, second])
        return least, most


jax.tree_util.register_dataclass(Slopes, data_fields=["eps", "least", "most"], meta_fields=[])


@eqx.filter_jit
def _slope(surface: AbstractSurface, sides: Sides, eps: Any) -> Any:
    def at(value: Any) -> Any:
        each = jnp.broadcast_to(value, sides.lower.shape)
        pulled = surface.pull_and_slope(each)[1]
        moved = psi_and_slope(each, sides)[1]
        return jnp.clip(pulled / jnp.maximum(moved, SLOPES[0]), *SLOPES)

    return jax.vmap(at)(eps)


def _later(values: Floats, span: int) -> Floats:
    """The values so many places on; the last ones again beyond the end."""
    return np.concatenate([values[:, span:], np.repeat(values[:, -1:], span, axis=1)], axis=1)
