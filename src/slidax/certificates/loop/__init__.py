"""Certificates of the joints' loops at the sampling rate: bounds of the tracking error for all members of a set."""

from .inertia_ratio import inertia_ratio as inertia_ratio
from .loop_rate import loop_rate as loop_rate
from .proved import BEGINNINGS as BEGINNINGS
