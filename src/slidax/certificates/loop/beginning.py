"""What is known of the loops of a set before anything is bounded: their beginning, and their pushes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop
from slidax.transformations import Sides

from .kernels import ACCELERATION, ERROR, ESTIMATE, LED, OUTPUTS
from .propagation import First
from .rule import aimed
from .signals import entries, followed, steady

if TYPE_CHECKING:
    from .assembled import Assembly

Floats = NDArray[np.floating[Any]]

Known: TypeAlias = tuple[Floats, Floats, Floats]
"""Responses without p and with some p held [N 2 9 n j] each, and how e bends [N n j]."""


def started(assembly: Assembly) -> tuple[Known, First]:
    """What is known of the loops, and bounds at the first sample, from the scenario's start."""
    narrowing, lead = assembly.narrowing, assembly.narrowing.lead
    noise = np.max(assembly.noise_size[LED], axis=1) + assembly.noise_start[0] + lead * assembly.noise_start[1]
    now, ahead = narrowing.now[0], narrowing.ahead[0]
    spread = ahead / now * (noise + assembly.horizon * assembly.subject.cover()[1])
    spread = np.minimum(spread, ahead * (narrowing.upper - narrowing.lower))
    y = assembly.e + lead * assembly.de
    sides = Sides(jnp.asarray(narrowing.lower), jnp.asarray(narrowing.upper))
    both = jnp.stack([jnp.maximum(-jnp.asarray(y), 0.0), jnp.maximum(jnp.asarray(y), 0.0)])
    surface, horizon = assembly.subject.surface, jnp.asarray(assembly.horizon)
    place = aimed(surface, sides, jnp.asarray(now), horizon, both, jnp.zeros_like(both))[1]
    aims = ahead * np.asarray(place[1] - place[0])
    begun = np.stack([np.maximum(-assembly.e, 0.0), np.maximum(assembly.e, 0.0)])
    return _known_of(assembly, aims), First.of(begun, spread, np.abs(aims - y) + spread + noise)


def entered(assembly: Assembly) -> tuple[Known, First]:
    """The same where the arms of the set are anywhere in a box around the ideal one."""
    assert assembly.since is not None
    free, bend = _pushed(assembly)
    held = free.copy()
    known = np.max(free[0, :, LED], axis=(0, 2))
    narrowing = assembly.narrowing
    slope = assembly.course.slopes.between(*(jnp.asarray(assembly.since.ideal.eps[0]),) * 2)[0]
    follows = narrowing.ahead[0] / (narrowing.now[0] + assembly.horizon * np.asarray(slope))
    for i, loop in enumerate(assembly.subject.loops):
        basis, sizes = entries(loop, float(follows[i]), assembly.since.states[:, :, i])
        for j, kappa in enumerate(assembly.kappa[i]):
            for column, size in zip(basis.T, sizes, strict=True):
                if size > 0.0:
                    alone, kept = _from(assembly, loop, kappa, column, float(follows[i]))
                    free[:, :, :, i, j] += size * np.abs(alone.T)[:, None]
                    held[:, :, :, i, j] += size * np.abs(kept.T)[:, None]
    error = np.max(free[0, :, ERROR], axis=2)
    slid = np.abs(assembly.since.slid)
    size = float(np.sqrt(slid @ assembly.sliding.mass[0] @ slid))
    return (free, held, bend), First.of(error, known, np.full_like(known, np.inf), size, follows)


def _from(assembly: Assembly, loop: LinearLoop, kappa: float, state: Floats, follows: float) -> tuple[Floats, Floats]:
    """What a loop does from a state without p, and with the p held that ŷ has at its beginning [9 N] each."""
    nothing = np.zeros((1, 2))
    alone = followed(loop, kappa, nothing, 0.0, state, assembly.samples).outputs[:, 0]
    place = follows * float(alone[LED, 0])
    return alone, followed(loop, kappa, nothing, place, state, assembly.samples).outputs[:, 0]


def _known_of(assembly: Assembly, aims: Floats) -> Known:
    """What the loops do with what is known, without p and with the first held [N 2 9 n j], and how e bends [N n j].

    Below and above zero, in size.
    """
    free, bend = _pushed(assembly)
    alone = np.empty((assembly.samples, OUTPUTS, *assembly.kappa.shape))
    nothing = np.zeros((1, 2))
    for i, loop in enumerate(assembly.subject.loops):
        still = np.zeros_like(_begun(assembly, i))
        for j, kappa in enumerate(assembly.kappa[i]):
            found = followed(loop, kappa, nothing, aims[i], still, assembly.samples, assembly.quiet)
            alone[:, :, i, j] = found.outputs[:, 0].T
    return free, free + alone[:, None] * np.array([-1.0, 1.0])[:, None, None, None], bend


def _pushed(assembly: Assembly) -> tuple[Floats, Floats]:
    """The loops from their start under the pushes, with noise."""
    h, (n, cells) = assembly.period, assembly.kappa.shape
    known = np.empty((assembly.samples, 2, OUTPUTS, n, cells))
    bend = np.empty((assembly.samples, n, cells))
    curve = 12.0 if assembly.subject.dead_time % 1.0 == 0 else 4.0
    for i, loop in enumerate(assembly.subject.loops):
        push = assembly.demand.push[:, :, i] * h * h
        begun = _begun(assembly, i) if assembly.since is None else steady(loop, push[:, 0])
        for j, kappa in enumerate(assembly.kappa[i]):
            found = followed(loop, kappa, push, 0.0, begun, assembly.samples, assembly.quiet)
            extra = assembly.noise_size[:, i, j, None] + _first_noise(assembly, i, kappa)
            outputs = found.outputs.copy()
            # Of the estimate what it misses of the push as it is when the torque sets in.
            outputs[ESTIMATE] -= push[:, assembly.late : assembly.late + assembly.samples]
            outputs[ACCELERATION] += kappa * found.least
            known[:, 0, :, i, j] = (np.max(-outputs, axis=1) + extra).T
            outputs[ACCELERATION] += kappa * (found.most - found.least)
            known[:, 1, :, i, j] = (np.max(outputs, axis=1) + extra).T
            bend[:, i, j] = kappa * np.max(found.change, axis=0) / curve
    return known, bend


def _first_noise(assembly: Assembly, joint: int, kappa: float) -> Floats:
    """What the noise of the first measurement does, since it is the first prediction as well [9 N]."""
    loop, queue, found = assembly.subject.loops[joint], _queue(assembly, joint), np.zeros((OUTPUTS, assembly.samples))
    if assembly.since is not None:
        # It is among what was seen.
        return found
    for k, size in enumerate(assembly.noise_start):
        if size[joint]:
            state = np.zeros_like(_begun(assembly, joint))
            state[2 + queue + k] = size[joint]
            found += np.abs(followed(loop, kappa, np.zeros((1, 2)), 0.0, state, assembly.samples).outputs[:, 0])
    return found


def _queue(assembly: Assembly, joint: int) -> int:
    return int(max(1, np.ceil(assembly.subject.loops[joint].believed)))


def _begun(assembly: Assembly, joint: int) -> Floats:
    """The loop's state at its first measurement, `quiet` periods before the start."""
    queue, quiet, h = _queue(assembly, joint), assembly.subject.quiet, assembly.period
    state = np.zeros(2 + queue + 6)
    speed = assembly.de[joint] * h
    state[0], state[1] = assembly.e[joint] - quiet * speed, speed
    # The arm is held until the first command sets in: behind a reference that accelerates.
    acts = np.arange(queue, 0, -1) - 1
    held = int(assembly.subject.dead_time) - 1 - acts[::-1] >= 0
    state[2 : 2 + queue] = np.where(held, -assembly.ddq[joint] * h * h, 0.0)
    state[2 + queue], state[3 + queue] = state[0], state[1]
    state[-2:] = state[:2] if _remembers(assembly, joint) else 0.0
    return state


def _remembers(assembly: Assembly, joint: int) -> bool:
    loop = assembly.subject.loops[joint]
    return loop.measures_velocity and loop.follows is not None
