"""The demand of a set of arms and disturbances on the joints' loops along a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .each import Floats
from .verdict import Assumption


@dataclass(frozen=True)
class Demand:
    """The disturbances that the joints' estimators must follow, and the error of the law's inertia.

    With `K = M⁻¹ M0` the error obeys `ë = K (a - q̈_r + w* - ŵ)`. Here a is the commanded acceleration, ŵ the estimate,
    and `w* = M0⁻¹ ((M0 - M) q̈_r + n0 - n + d)` the disturbance that the law must compensate; n is the arm's torque
    without inertia, d the external torque. Along the reference the disturbance of each member is, as a signal,
    `Σ λ_m (push_m + Σ x_k effects_mk)` with `λ >= 0`, `Σ λ = 1` and `|x_k| <= 1`, the same for all times and joints.

    - `times`: samples, a period apart [N], s.
    - `push`: w* along the reference for each extreme member [members N n], rad/s² or m/s².
    - `stray`: bound of the rest of w* at each time and joint, without any smoothness, anywhere in the envelope [N n],
      rad/s² or m/s²; inf if none is known. `deviation` gives a smaller one for smaller errors.
    - `kappa`: the least and the largest diagonal of K [2 n].
    - `coupling`: bounds of |K_ij/K_jj| for i ≠ j, the effect of other joints' accelerations [n n].
    - `assumptions`: of `push`, `stray` and their bounds; `of_kappa`: of `kappa` and `coupling`.
    - `effects`: change of each `push` by half the width of an uncertain value [members values N n], rad/s² or m/s².
    - `deviation`: from bounds of the error and its rate, each [n] or [N n], to the bound of `stray` [N n].
    - `prediction_error`: from bounds of the prediction errors of q and q̇ [N n] to the error of the torque [N n].
    - `jumps`: part of `stray`: forces off the line between two samples, and jumps of payloads [N n].
    - `matrices`: K of some members at some instants of the motion, with the worst coupled one [I n n].
    - `relearning`: steps of ŵ when the law changes its learned inertia [N n]; None if it never does.
    """

    times: Floats
    push: Floats
    stray: Floats
    kappa: Floats
    coupling: Floats
    assumptions: Sequence[Assumption]
    effects: Floats | None = None
    deviation: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    prediction_error: Callable[[Floats, Floats], Floats] | None = field(default=None, repr=False)
    relearning: Floats | None = None
    of_kappa: Sequence[Assumption] = ()
    jumps: Floats | None = None
    matrices: Floats | None = None

    def boxed(self) -> Demand:
        """Return the demand with all effects in `stray`, by `|Σ x_k effects_k| <= Σ |effects_k|`.

        This is larger than necessary, because the effects may then change in any way over time.
        """
        if self.effects is None or not self.effects.shape[1]:
            return self
        widened = self.stray + np.abs(self.effects).sum(axis=1).max(axis=0)
        return replace(self, stray=widened, effects=None)

    def worst(self, through: Callable[[Floats], Floats]) -> Floats:
        """Return the largest |value| of a linear map of the disturbance over all members at each time and joint [N n].

        A member attains it, though not the same one at each time.

        - `through`: from signals [... N n] to such signals: the loops' response, or the identity.
        """
        size = np.abs(through(self.push))
        if self.effects is not None and self.effects.shape[1]:
            size = size + np.abs(through(self.effects)).sum(axis=1)
        return size.max(axis=0)
