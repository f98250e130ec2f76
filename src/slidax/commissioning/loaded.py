"""An arm with an additional payload, for the choice of its drives and motion."""

from __future__ import annotations

import equinox as eqx
import numpy as np

from slidax._errors import as_array
from slidax.robots import Articulated


def with_tip_mass(arm: Articulated, share: float) -> Articulated:
    """Return the arm with a share of its moving mass at the tip, in addition to its payload."""
    mass = float(arm.payload.mass) + share * float(np.sum(np.asarray(arm.masses)))
    return eqx.tree_at(lambda arm: arm.payload.mass, arm, as_array(mass))
