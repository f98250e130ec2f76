"""Certificates of the joints' loops at the sampling rate: bounds of the tracking error for all members of a set.

`loop_rate.py` is the certificate; docs/certificates/loop-rate.md derives it with the same letters. `problem.py` says
which scenarios it covers, `initial_set.py` where the bound begins, `bound_recursion.py` how it goes from sample to
sample, `decoupled_bound.py` and `coupled_bound.py` how joints act on each other, and `fixed_point.py` when the bound
confirms itself.

Read first: `loop_rate.py`, `problem.py`, `bound_recursion.py`.
"""

from .inertia_ratio import inertia_ratio as inertia_ratio
from .loop_rate import loop_rate as loop_rate
from .set_bound import BEGINNINGS as BEGINNINGS
