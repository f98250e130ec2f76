"""Motion of a released payload."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from jaxtyping import Float


class FreeBody(eqx.Module):
    """Pose of a released payload at the m samples that were logged since its release.

    Its frame is the tip's at the release; the payload's centre and inertia are relative to that frame.

    - `t`: time [m], s.
    - `rotation`: axes as columns, in the base frame [m 3 3].
    - `place`: origin, in the base frame [m 3], m.
    """

    t: Float[np.ndarray, " m"]
    rotation: Float[np.ndarray, "m 3 3"]
    place: Float[np.ndarray, "m 3"]
