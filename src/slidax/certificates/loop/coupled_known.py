"""What the loops of all joints do with what is known, for one matrix K: where they begin, and the pushes of a set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from .coupled_maps import CoupledMaps
from .kernels import ACCELERATION, ESTIMATE, MISSED, OUTPUTS, outputs_of
from .signals import entries

Floats = NDArray[np.floating[Any]]


def begun(
    maps: CoupledMaps, loops: Sequence[LinearLoop], follows: Floats, states: Floats, span: range
) -> tuple[Floats, Floats]:
    """What the loops do from where the arms of a set may be at the first sample, in size [K 9 n] each.

    Without p, and with the p held that ŷ has there.

    - `maps`, `loops`: of all joints.
    - `follows`: θ [n].
    - `states`: as in `Entry` [m 8 + Q n].
    - `span`: of the decisions.
    """
    n, size = maps.joints, maps.step.shape[0]
    columns, places = [], []
    for j, loop in enumerate(loops):
        basis, reach = entries(loop, float(follows[j]), states[:, :, j])
        whole = maps.placed(basis * reach, j)[:, reach > 0.0]
        columns.append(whole)
        held = np.zeros((n, whole.shape[1]))
        held[j] = follows[j] * (maps.asked[2, j] @ whole)
        places.append(held)
    start, place = np.concatenate(columns, axis=1), np.concatenate(places, axis=1)
    if not start.shape[1]:
        return (np.zeros((len(span), OUTPUTS, n)),) * 2
    # p stays, as a state that keeps itself.
    step = np.block([[maps.step, maps.enters[2]], [np.zeros((n, size)), np.eye(n)]])
    rows = np.concatenate([maps.asked.reshape(7 * n, size), maps.direct[2].reshape(7 * n, n)], axis=1)
    both = np.concatenate([start, start], axis=1)
    state = np.concatenate([both, np.concatenate([0.0 * place, place], axis=1)])
    state = np.linalg.matrix_power(step, span.start) @ state
    count = len(span) + int(loops[0].believed) + 2
    raw = np.empty((count, 7 * n, state.shape[1]))
    for k in range(count):
        raw[k] = rows @ state
        state = step @ state
    found = outputs_of(
        raw.reshape(count, 7, n, -1).swapaxes(0, 1), np.arange(len(span)), int(loops[0].believed), loops[0], 1.0
    )
    half = start.shape[1]
    found[MISSED, :, :, half:] -= place
    sizes = np.abs(found).swapaxes(0, 1)
    return sizes[..., :half].sum(axis=-1), sizes[..., half:].sum(axis=-1)


def pushed(
    maps: CoupledMaps, loop: LinearLoop, matrix: Floats, pushes: tuple[Floats, Floats], span: range, memory: int
) -> tuple[Floats, Floats]:
    """What the pushes of a set do to the loops that they have brought to rest, below and above zero [K 2 9 n].

    And by how much they bend e at most [K n]. What is older than the memory counts as it was then; what it was
    otherwise is in the tails of the kernels.

    - `maps`: of all joints; `loop`: any of them.
    - `matrix`: K.
    - `pushes`: w* at the arm's samples, linear in between, of each corner [M T n]; and what half the width of an
      uncertain number adds [E T n]; in units of periods.
    - `span`: of the decisions.
    - `memory`: periods.
    """
    corners, effects = pushes
    every = np.concatenate([corners, effects])
    n, whole = maps.joints, int(loop.believed)
    first = max(0, span.start - memory)
    last = span.stop + whole + 3
    given = np.moveaxis(every[:, first : last + 1], 0, -1)
    given = np.concatenate([given, np.repeat(given[-1:], max(last + 1 - first - len(given), 0), axis=0)])
    state = np.zeros((maps.step.shape[0], len(every)))
    queue = maps.own - 8
    for j in range(n):
        at = j * maps.own
        state[at + 2 : at + 2 + queue] = -given[0, j]
        state[at + 4 + queue] = given[0, j]
    rows = maps.asked.reshape(7 * n, -1)
    through = maps.direct.reshape(5, 7 * n, n)
    entered = given[:-1].swapaxes(0, 1).reshape(n, -1), given[1:].swapaxes(0, 1).reshape(n, -1)
    forced = (maps.enters[3] @ entered[0] + maps.enters[4] @ entered[1]).reshape(state.shape[0], -1, len(every))
    skip = span.start - first
    raw = np.empty((last - span.start, 7 * n, len(every)))
    for k in range(last - first):
        if k >= skip:
            raw[k - skip] = rows @ state + through[3] @ given[k] + through[4] @ given[k + 1]
        state = maps.step @ state + forced[:, k]
    found = outputs_of(raw.reshape(len(raw), 7, n, -1).swapaxes(0, 1), np.arange(len(span)), whole, loop, 1.0)
    # When the torque of a decision sets in, and until the next does.
    knots = np.array(
        [given[skip + whole + k : skip + whole + k + len(span)] for k in range(2 + (loop.believed % 1.0 > 0))]
    )
    found[ESTIMATE] -= knots[0]
    corner, effect = np.split(found, [len(corners)], axis=-1)
    moves, adds = np.split(knots, [len(corners)], axis=-1)
    acts = np.max(np.abs(effect[ACCELERATION] + adds), axis=0)
    more = np.abs(effect)
    more[ACCELERATION] = acts
    more = more.sum(axis=-1)
    above, below = corner.copy(), -corner
    above[ACCELERATION] += moves.max(axis=0)
    below[ACCELERATION] -= moves.min(axis=0)
    sizes = np.stack([below.max(axis=-1) + more, above.max(axis=-1) + more])
    turned = np.abs(np.einsum("ij,ckjm->ckim", matrix, np.diff(knots, axis=0)))
    bend = turned[..., : len(corners)].max(axis=(0, 3)) + turned[..., len(corners) :].max(axis=0).sum(axis=-1)
    return sizes.transpose(2, 0, 1, 3), bend
