"""How much of what comes into the loops of all joints arrives where, for one matrix K: responses in size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from .coupled_maps import CoupledMaps
from .kernels import (
    ACCELERATION,
    ERROR,
    ESTIMATE,
    LAPSE,
    LED,
    MISSED,
    OUTPUTS,
    SHIFT,
    SLIP,
    SPEED,
    largest_within,
    outputs_of,
)

Floats = NDArray[np.floating[Any]]

LENGTHS = tuple(256 * k for k in range(1, 9))
"""Of impulse responses [periods]: the first after which little is left."""

LITTLE = 1e-5
"""Of a state, after one length."""

LAGS = 4
"""That are taken together, with the largest of what came in at them."""


@dataclass(frozen=True)
class CoupledKernels:
    """Of all loops for one K; units of periods. From the last axis's joint, or rows of joint and lag, to each output.

    The outputs are those of `kernels`, but that of the acceleration is `a + w*` without K.

    - `newest`: what pushes, places and changes of place do at once [3 9 n n].
    - `older`: what they do from one period later on, LAGS of them together [3 9n nB].
    - `tails`: what is older than these does at most, times the largest that came in [3 9 n n].
    - `of_command`, `of_estimate`: sums of sizes, as in `Kernels` [9 n n].
    - `noise`, `noise_square`: the same of a measurement's noise, position and velocity, and of their squares [2 9 n n].
    """

    newest: Floats
    older: Floats
    tails: Floats
    of_command: Floats
    of_estimate: Floats
    noise: Floats
    noise_square: Floats

    @classmethod
    def of(cls, maps: CoupledMaps, loop: LinearLoop, length: int) -> CoupledKernels:
        """Those of some maps.

        - `maps`: of all loops.
        - `loop`: of any joint, for horizon and delay.
        - `length`: from `length_of`.
        """
        n, whole = maps.joints, int(loop.believed)
        steps = length + whole + 3
        kicks = np.eye(maps.step.shape[0])
        place = maps.enters[2]
        # Of p held from some time on, less where it leads in the end.
        held = -np.linalg.solve(np.eye(maps.step.shape[0]) - maps.step, place)
        first = [kicks[:, k :: maps.own] for k in (0, 1)]
        sources = [*first, place, maps.enters[0], maps.enters[1], kicks[:, maps.own - 4 :: maps.own], held]
        powers = _powers(maps.step, np.concatenate(sources, axis=1), steps)
        rows = (maps.asked.reshape(7 * n, -1) @ powers).reshape(steps, 7, n, len(sources), n).swapaxes(0, 1)
        raw = np.concatenate([np.zeros((7, 1, *rows.shape[2:])), rows], axis=1)
        for source, which in ((2, 2), (3, 0), (4, 1)):
            raw[:, 0, :, source] = maps.direct[which]

        def seen(source: int, at: Any) -> Floats:
            return outputs_of(raw[:, :, :, source], at, whole, loop, 1.0)

        lags = np.arange(length)
        pushed = largest_within(seen(1, lags - whole), seen(0, lags - whole))
        placed = seen(2, lags)
        placed[MISSED, 0] -= np.eye(n)
        jumped = outputs_of(raw[:, 1:, :, 5], lags, whole, loop, 1.0)
        noisy = np.array([seen(source, np.arange(-whole - 1, length)) for source in (3, 4)])

        tails = _tails(maps, loop, powers, length).reshape(OUTPUTS, n, len(sources), n)
        whole_place = placed.copy()
        whole_place[MISSED, 0] += np.eye(n)
        kernels = np.stack([pushed, np.abs(placed), np.abs(np.cumsum(placed, axis=1))])
        blocks = kernels[:, :, 1:].reshape(3, OUTPUTS, -1, LAGS, n, n).sum(axis=3)
        noise_tail = np.stack([tails[:, :, 3], tails[:, :, 4]])
        return cls(
            newest=kernels[:, :, 0],
            older=blocks.transpose(0, 1, 3, 2, 4).reshape(3, OUTPUTS * n, -1),
            tails=np.stack([tails[:, :, 0] + tails[:, :, 1], tails[:, :, 2], tails[:, :, 6]]),
            of_command=loop.horizon**2 * (np.sum(np.abs(whole_place), axis=1) + tails[:, :, 2]),
            of_estimate=np.sum(np.abs(jumped), axis=1) + tails[:, :, 5],
            noise=np.sum(np.abs(noisy), axis=2) + noise_tail,
            noise_square=np.sum(noisy**2, axis=2) + noise_tail**2,
        )


def length_of(maps: list[CoupledMaps]) -> int | None:
    """A length after which little is left of any state in all of them, a multiple of LAGS and one; None for too long.

    - `maps`: for each K.
    """
    longest = 0
    for one in maps:
        fits = [k for k, length in enumerate(LENGTHS) if _left(one.step, length) < LITTLE]
        if not fits:
            return None
        longest = max(longest, fits[0])
    return LENGTHS[longest] + 1


def _left(step: Floats, length: int) -> float:
    return float(np.max(np.sum(np.abs(np.linalg.matrix_power(step, length)), axis=1)))


def _powers(step: Floats, first: Floats, count: int) -> Floats:
    """`step^k first` for k from 0 on [K S m]."""
    found = np.empty((count, *first.shape))
    found[0] = first
    for k in range(1, count):
        np.matmul(step, found[k - 1], out=found[k])
    return found


def _tails(maps: CoupledMaps, loop: LinearLoop, powers: Floats, length: int) -> Floats:
    """Bounds of what each source does later than the responses reach [9 n m].

    `Σ_{k >= K} |c step^k x|` is at most |c| times the sum of the sizes of `step^k x`: those that were computed, and of
    all later ones `f/(1 - f)` times the sum over one length, f being what one length leaves.
    """
    whole, lead, r = int(loop.believed), loop.horizon - 0.5, 1.0 / loop.horizon
    asked, step = maps.asked, maps.step
    later = np.linalg.matrix_power(step, whole)
    rows = np.empty((OUTPUTS, *asked.shape[1:]))
    rows[LED] = asked[2]
    rows[ERROR] = asked[0] @ later
    rows[MISSED] = (asked[2] @ step - (1.0 - r) * asked[2]) / r
    rows[SHIFT] = (asked[0] + lead * asked[1]) @ later - asked[2]
    rows[SLIP] = asked[3] @ step - asked[3] - asked[5]
    rows[ACCELERATION] = asked[4]
    rows[ESTIMATE] = asked[6]
    rows[SPEED] = asked[1] @ later
    rows[LAPSE] = rows[SPEED] - asked[3]
    left = _left(step, length)
    sizes = np.max(np.abs(powers), axis=1)
    total = sizes[length - whole - 2 :].sum(axis=0) + left / (1.0 - left) * sizes[:length].sum(axis=0)
    found: Floats = np.sum(np.abs(rows), axis=2)[:, :, None] * total
    return found
