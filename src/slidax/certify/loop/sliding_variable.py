"""Bound of the sliding variable, and the part of the estimate that the law does not compensate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import numpy as np

from ..arm.arm_motion import mass_and_bias
from ..sampled_scenario import Floats
from .envelope import map_rows
from .initial_set import NominalRun
from .problem import LoopProblem


@dataclass(frozen=True)
class SlidingVariableBounds:
    """At each time at which a torque starts.

    - `root`: root of the largest eigenvalue of M0 [N]; `inertia`: M0, `mass`: |M0| [N n n].
    - `grown`: growth of the norm of M0 to the next sample [N].
    - `size`: `‖s‖` of the nominal run in the norm of M0 [N]; `s_next`: its |s⁺| [N n]; `cover`: u [N], N m.
    """

    root: Floats
    inertia: Floats
    mass: Floats
    grown: Floats
    size: Floats
    s_next: Floats
    cover: Floats

    @classmethod
    def of(cls, subject: LoopProblem, ideal: NominalRun | None, times: Floats, most: int = 0) -> SlidingVariableBounds:
        """The quantities of a law.

        - `ideal`: its planned run; None if s counts as reached from the start.
        - `times`: at which torques start [N], s.
        - `most`: largest number of times of all calls that share the compiled program.
        """
        law, n = subject.law, times.size
        if ideal is None:
            heavy = subject.heavy(times)
            none = np.zeros((n, law.joints))
            even = heavy[:, None, None] * np.eye(law.joints)
            return cls(np.sqrt(heavy), even, even, np.ones(n), np.zeros(n), none, np.full(n, subject.cover()[0]))
        motion = ideal.motion
        mass: Floats = mass_and_bias(law.nominal, None, motion.t, motion.q, motion.dq)[0]
        if law.adaptation is not None:
            mass = map_rows(_at_start, mass, most, law.adaptation)
        mass = np.concatenate([mass, mass[-1:]])
        factor = np.linalg.cholesky(mass)
        inner = np.linalg.solve(factor[:-1], np.swapaxes(np.linalg.solve(factor[:-1], mass[1:]), 1, 2))
        grown = np.sqrt(np.maximum(np.linalg.eigvalsh(inner)[:, -1], 1.0))
        at = np.minimum(np.searchsorted(motion.t, times + 1e-9) - 1, len(motion.t) - 1)
        s = ideal.sliding[:n]
        size = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", s, mass[at], s), 0.0))
        return cls(
            root=np.sqrt(np.linalg.eigvalsh(mass[at])[:, -1]),
            inertia=mass[at],
            mass=np.abs(mass[at]),
            grown=grown[at],
            size=size,
            s_next=np.abs(ideal.s_next[:n]),
            cover=ideal.cover[:n],
        )


@eqx.filter_jit
def _at_start(adaptation: Any, mass: Any) -> Any:
    return jax.vmap(adaptation.mass_at_start)(mass)
