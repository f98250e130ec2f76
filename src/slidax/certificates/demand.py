"""What a set of arms and disturbances asks of the loops of the joints along a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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

    Along the reference the push of each member is, as a signal,
    `Σ λ_m (push_m + Σ x_k effects_mk)` with `λ >= 0`, `Σ λ = 1` and `|x_k| <= 1`, the same for all times and joints.

    - `times`: of the samples, a period apart [N], s.
    - `push`: w* along the reference, for each extreme member of the set [members N n], rad/s² or m/s².
    - `stray`: a bound of what w* may be otherwise at a time and joint, without any smoothness, where the arm is
      anywhere in its envelope [N n], rad/s² or m/s²; inf where none is known; `beside` gives less for a smaller error.
    - `kappa`: the least and the largest of K's diagonal [2 n].
    - `coupling`: bounds of what the other joints' accelerations do to a joint, |K_ij/K_jj| for i ≠ j [n n].
    - `assumptions`: what `push`, `stray` and what is made of them stand on; `of_kappa`: what `kappa` and `coupling` do.
    - `effects`: what half the width of an uncertain number adds to each push [members numbers N n], rad/s² or m/s²;
      none if not given.
    - `beside`: from bounds of the error and of its rate, each [n] or [N n], to the same bound as `stray` [N n].
    - `misread`: from bounds of what a prediction misses of q and q̇ [N n], what its torque does otherwise [N n].
    - `jumping`: the part of `stray` by which forces leave the line between two samples, and payloads jump [N n].
    - `matrices`: K of some members at some instants of the motion, the worst coupled among them [I n n].
    - `relearnt`: by how much ŵ steps because the law believes another inertia than before [N n]; None for never.
    """

    times: Floats
    push: Floats
    stray: Floats
    kappa: Floats
    coupling: Floats
    assumptions: Sequence[Assumption]
    effects: Floats | None = None
    beside: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    misread: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    relearnt: Floats | None = None
    of_kappa: Sequence[Assumption] = ()
    jumping: Floats | None = None
    matrices: Floats | None = None

    def boxed(self) -> Demand:
        """The same with all effects in `stray`, for what takes each push alone: `|Σ x_k effects_k| <= Σ |effects_k|`.

        Larger than it need be, since then they may change in any way over time.
        """
        if self.effects is None or not self.effects.shape[1]:
            return self
        widened = self.stray + np.abs(self.effects).sum(axis=1).max(axis=0)
        return replace(self, stray=widened, effects=None)

    def worst(self, through: Callable[[Floats], Floats]) -> Floats:
        """The largest |value| that a linear map of the push can have over all members at each time and joint [N n].

        It is attained by a member, though not by the same at each time.

        - `through`: from signals [... N n] to such signals: the loops' answer, or the push itself by `lambda w: w`.
        """
        size = np.abs(through(self.push))
        if self.effects is not None and self.effects.shape[1]:
            size = size + np.abs(through(self.effects)).sum(axis=1)
        return size.max(axis=0)
