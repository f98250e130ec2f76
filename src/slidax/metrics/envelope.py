"""Whether the promise was kept, and by how much."""

from __future__ import annotations

import numpy as np

from slidax.simulation import Run


def envelope_violations(run: Run) -> int | None:
    """How many samples had a joint at or outside its bounds (12); None for a scheme that promises none.

    - `run`: a finished run.
    """
    return int(run.tally.violations) if run.has_envelope else None


def envelope_margin(run: Run) -> np.ndarray | None:
    """Min over time of the distance to the nearer bound, over the envelope's width, [n].

    None for a scheme without an envelope, and for a run whose very first sample was not good.

    - `run`: a finished run.
    """
    return np.asarray(run.tally.margin) if run.has_envelope and int(run.tally.samples) else None
