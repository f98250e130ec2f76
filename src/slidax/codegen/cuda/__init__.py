"""Compile programs to CUDA kernels that compute one run of a batch in each thread."""

from .kernel import kernel as kernel
from .launch import Kernel as Kernel
from .launch import available as available
from .launch import compile as compile
from .launch import require_card as require_card
