"""The loops of the joints at the arm's own rate: what of the error is certain, for all arms of a set."""

from .inertia_ratio import inertia_ratio as inertia_ratio
from .loop_rate import loop_rate as loop_rate
from .proved import BEGINNINGS as BEGINNINGS
