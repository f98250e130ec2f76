"""A rigid body by its principal axes, and the box that is like it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import Payload

ROUNDING = 1e-6
"""By this share the largest moment may exceed the sum of the others: printed numbers are rounded."""

DENSITY = 2700.0
"""Of a load whose inertia is 0, a point's: once let go, it is a cube of aluminium, kg/m³."""

THIN = 1e-3
"""Half of a box's least thickness [m]."""


class Principal(NamedTuple):
    """An inertia by its principal axes.

    - `moments`: about them [3], kg m².
    - `axes`: as columns [3 3], right-handed.
    """

    moments: np.ndarray
    axes: np.ndarray


def principal(inertia: np.ndarray) -> Principal:
    """The principal moments and axes of an inertia.

    - `inertia`: about the centre of mass [3 3], kg m².
    """
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    moments = np.maximum(moments, 0.0)
    # MuJoCo refuses what a rigid body cannot have by however little; the moments are in increasing order.
    moments[2] = min(moments[2], moments[0] + moments[1])
    return Principal(moments, axes)


class Box(NamedTuple):
    """A box of even density, along its principal axes.

    - `sides`: half of each [3], m.
    - `moments`: about the axes [3], kg m².
    """

    sides: np.ndarray
    moments: np.ndarray


def box_like(mass: float, moments: np.ndarray) -> Box:
    """The box of even density with these moments; one that is too thin to fall and roll is made thicker.

    - `mass`: kg, > 0.
    - `moments`: [3], kg m²; all 0 for a point, which becomes a cube by its weight.
    """
    if moments.any():
        squares = 1.5 / mass * (moments.sum() - 2.0 * moments)
        sides = np.maximum(np.sqrt(np.maximum(squares, 0.0)), THIN)
    else:
        sides = np.full(3, 0.5 * (mass / DENSITY) ** (1.0 / 3.0))
    return Box(sides, mass / 3.0 * ((sides**2).sum() - sides**2))


def require_rigid(payload: Payload) -> None:
    """Raises DefinitionError if no rigid body has these moments: one that is let go could not fall.

    - `payload`: with known numbers.
    """
    moments = np.linalg.eigvalsh(np.asarray(payload.inertia))
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        listed = ", ".join(f"{moment:.3g}" for moment in moments)
        raise DefinitionError(
            f"`Payload.inertia` is of no rigid body: the largest of its principal moments {listed} kg m² is more than "
            "the sum of the others"
        )
