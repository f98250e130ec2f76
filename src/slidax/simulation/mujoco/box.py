"""Principal axes of a rigid body, and the homogeneous box with equal moments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Payload

ROUNDING = 1e-6
"""Relative excess of the largest moment over the sum of the others, for rounded data."""

DENSITY = 2700.0
"""Density of a released point mass, which becomes a cube of aluminium, kg/m³."""

THIN = 1e-3
"""Smallest half thickness of a box [m]."""


class Principal(NamedTuple):
    """Principal moments [3], kg m², and axes as columns [3 3], right-handed."""

    moments: np.ndarray
    axes: np.ndarray


def principal(inertia: np.ndarray) -> Principal:
    """Return the principal moments and axes of an inertia about the centre of mass [3 3], kg m²."""
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    moments = np.maximum(moments, 0.0)
    # MuJoCo rejects the smallest excess over a rigid body's moments. The moments are in increasing order.
    moments[2] = min(moments[2], moments[0] + moments[1])
    return Principal(moments, axes)


class Box(NamedTuple):
    """A homogeneous box along its principal axes: half sides [3], m, and moments [3], kg m²."""

    sides: np.ndarray
    moments: np.ndarray


def box_like(mass: float, moments: np.ndarray) -> Box:
    """Return the homogeneous box with these moments, with a minimum thickness so that it can fall and roll.

    - `moments`: [3], kg m²; all 0 for a point mass, which becomes a cube.
    """
    if moments.any():
        squares = 1.5 / mass * (moments.sum() - 2.0 * moments)
        sides = np.maximum(np.sqrt(np.maximum(squares, 0.0)), THIN)
    else:
        sides = np.full(3, 0.5 * (mass / DENSITY) ** (1.0 / 3.0))
    return Box(sides, mass / 3.0 * ((sides**2).sum() - sides**2))


def require_rigid(payload: Payload) -> None:
    """Raise a DefinitionError if no rigid body has the payload's moments."""
    moments = np.linalg.eigvalsh(np.asarray(payload.inertia))
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        listed = ", ".join(f"{moment:.3g}" for moment in moments)
        raise DefinitionError(
            f"no rigid body has this `Payload.inertia`: the largest of its principal moments {listed} kg m² is more "
            "than the sum of the others"
        )
