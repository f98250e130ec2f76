"""What a set of arms and disturbances asks of the loops of the joints along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .verdict import Assumption

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Demand:
    """What the estimators of the joints must follow, and how wrong the law's inertia may be.

    With `K = M⁻¹ M0` the error moves as `ë = K (a - q̈_r + w* - ŵ)`, a being the acceleration that the law commands,
    ŵ its estimate, and `w* = M0⁻¹ ((M0 - M) q̈_r + n0 - n + d)` the push that makes the error vanish; n is everything
    of the arm but its inertia, d what pushes from outside.

    - `times`: of the samples, a period apart [N], s.
    - `push`: w* along the reference, for each extreme member of the set [members N n], rad/s² or m/s².
    - `stray`: a bound of what w* may be otherwise at a time and joint, without any smoothness: between the extreme
      members, and since the arm is beside its reference [N n], rad/s² or m/s².
    - `kappa`: the least and the largest of K's diagonal [2 n].
    - `coupling`: bounds of what the other joints' accelerations do to a joint, |K_ij/K_jj| for i ≠ j [n n].
    - `assumptions`: what these numbers stand on.
    """

    times: Floats
    push: Floats
    stray: Floats
    kappa: Floats
    coupling: Floats
    assumptions: Sequence[Assumption]
