"""The motion of a body that was let go."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from jaxtyping import Float


class FreeBody(eqx.Module):
    """Where a load is after it was let go, at the samples that were logged from then on.

    Its frame is that of the tip at the moment it was let go; the load's own centre and inertia are given in it.

    - `t`: time [m], s.
    - `rotation`: its axes, as columns, in the base frame [m 3 3].
    - `place`: in the base frame [m 3], m.
    """

    t: Float[np.ndarray, " m"]
    rotation: Float[np.ndarray, "m 3 3"]
    place: Float[np.ndarray, "m 3"]
