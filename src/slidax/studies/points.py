"""Points of the unit cube by the number of their row: each can be had alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WORDS = 4
"""64-bit numbers that one step of the generator's counter gives."""


def points(seed: int, first: int, rows: int, dimensions: int) -> NDArray[np.float64]:
    """Uniform points [rows, dimensions], independent of how many others are drawn with them.

    They are read off one stream (Philox, Salmon et al. 2011), in which each row has its own place.

    - `seed`: of the stream.
    - `first`: number of the first row.
    - `rows`: how many.
    - `dimensions`: of the cube.
    """
    steps = -(-max(dimensions, 1) // WORDS)
    stream = np.random.Philox(key=seed)
    stream.advance(first * steps)
    drawn = np.random.Generator(stream).random((rows, steps * WORDS))
    return drawn[:, :dimensions]
