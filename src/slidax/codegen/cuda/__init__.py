"""CUDA kernels of programs: each thread computes one run of a batch."""

from .launch import CudaKernel as CudaKernel
from .launch import card_available as card_available
from .launch import require_card as require_card
from .source import cuda_code as cuda_code
