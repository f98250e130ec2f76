"""Numbers in sentences."""

from __future__ import annotations

from typing import Any

import numpy as np


def listed(values: Any, digits: int = 3) -> str:
    """Format one number, or one per joint with commas if they differ: `1.2, 3.4, 5.6`."""
    words = [f"{float(value):.{digits}g}" for value in np.atleast_1d(np.asarray(values, float))]
    return words[0] if len(set(words)) == 1 else ", ".join(words)
