"""An arm with something at its tip, while its drives are looked at."""

from __future__ import annotations

import equinox as eqx
import numpy as np

from slidax._errors import as_array
from slidax.robots import Articulated


def loaded(arm: Articulated, share: float) -> Articulated:
    """The arm with a share of its moving mass at the tip, beside what it carries already.

    - `arm`: the arm.
    - `share`: of the mass.
    """
    mass = float(arm.payload.mass) + share * float(np.sum(np.asarray(arm.masses)))
    return eqx.tree_at(lambda one: one.payload.mass, arm, as_array(mass))
