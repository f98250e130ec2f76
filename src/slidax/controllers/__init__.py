"""Whole control schemes, as recipes over the shared parts."""

from .cftsmppc import cftsmppc as cftsmppc
from .controller import AbstractController as AbstractController
from .sliding_mode import SlidingMode as SlidingMode
