"""From a scenario and what a set of arms asks of it to the bounds of its errors along time."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..demand import Demand
from .apart import Apart, propagated
from .beginning import entered, started
from .cells import cells_of
from .kernels import ERROR, OUTPUTS, Kernels
from .propagation import Passing
from .setting import Certified, Setting, Since
from .subject import Subject

Floats = NDArray[np.floating[Any]]


class Assembly(Setting):
    """All of a scenario's bounds but for what the arm asks for beside its motion, so that they can be found for more.

    Each joint's loop is followed by itself, and what moves it with another counts as a push.

    - `subject`, `demand`, `since`: as of `Setting`.
    - `chance`: that normal noise is larger than is counted at some sample of the run.
    """

    def __init__(self, subject: Subject, demand: Demand, chance: float = 1e-3, since: Since | None = None) -> None:
        super().__init__(subject, demand, since)
        # A joint whose own inertia the others outweigh answers a torque the wrong way: no loop of it settles.
        answers = bool(np.all(demand.kappa > 0))
        self.kappa, self.spread = cells_of(demand.kappa) if answers else (demand.kappa.T, np.zeros_like(demand.kappa.T))
        self.kernels = Kernels.of(subject.loops, self.kappa) if answers else None
        if self.kernels is None:
            return
        times = self.samples * subject.law.joints * OUTPUTS
        self.noise_size = self.noise.size(self.period, self.kernels.noise, self.kernels.noise_square, times, chance)
        self.noise_start = self.noise.start(self.period, times, chance)
        self.known, self.first = started(self) if since is None else entered(self)

    @property
    def stable(self) -> bool:
        """Whether all loops forget."""
        return self.kernels is not None

    @property
    def signed_error(self) -> Floats:
        """What an acceleration that is constant over a period does to e, by the lag, for the middle κ [n L]."""
        assert self.kernels is not None
        length = self.kernels.of_push.shape[-1]
        found = []
        for loop, row in zip(self.subject.loops, self.kappa, strict=True):
            maps = loop.maps(float(row[row.size // 2]))
            state = maps.enters[:, 3] + maps.enters[:, 4]
            errors = []
            for _ in range(length):
                errors.append(maps.asked[0] @ state)
                state = maps.step @ state
            found.append(errors)
        return np.array(found)

    def certified(self, more: Floats | None = None, misread: Floats | None = None) -> Certified:
        """The bounds.

        - `more`: what w* may be otherwise at each sample of the arm, beyond `demand.stray` [N n], rad/s² or m/s².
        - `misread`: by how much a command may be another where it is predicted [N n], likewise.
        """
        bounds = propagated(self.course, self._apart(), self._passing(more, misread), self.first, self.most)
        error, share = self.error_of(bounds)
        noise = np.max(self.noise_size[ERROR], axis=1)
        return Certified(self.subject, self.narrowing, bounds, error, share, self.kappa, self.spread, noise)

    def _apart(self) -> Apart:
        found = self.kernels
        assert found is not None
        push, place, change = (jnp.asarray(one[..., ::-1]) for one in (found.of_push, found.of_place, found.of_change))
        return Apart(
            kernels=(push, place, change),
            tails=(jnp.asarray(found.push_tail), jnp.asarray(found.place_tail), jnp.asarray(found.change_tail)),
            fading=jnp.asarray(found.fading),
            spread=jnp.asarray(self.spread),
            kappa=jnp.asarray(self.kappa),
            coupling=jnp.asarray(self.demand.coupling),
        )

    def _passing(self, more: Floats | None, misread: Floats | None) -> Passing:
        narrowing, sliding = self.narrowing, self.sliding
        free, held, bend = self.known
        if misread is not None:
            extra = self._misled(misread)
            free, held = free + extra, held + extra
        stray = self.strayed(more)
        target, eps, turn = self.planned()
        given = (narrowing.now, narrowing.ahead, free, held, stray, bend, target, eps, turn)
        reached = (sliding.size, sliding.s_next, sliding.root, sliding.mass, sliding.grown)
        return Passing(*(jnp.asarray(one) for one in (*given, *reached)))

    def _misled(self, misread: Floats) -> Floats:
        """What commands that are predicted as others do at most, by the largest of those that are not forgotten."""
        assert self.kernels is not None
        length = self.kernels.of_push.shape[-1]
        found: Floats = self.recent(misread, length)[:, None, None, :, None] * self.kernels.of_command[None, None]
        if self.demand.relearnt is not None:
            moved = self.recent(self.demand.relearnt, length)
            found = found + moved[:, None, None, :, None] * self.kernels.of_estimate[None, None]
        return found
