"""From a pure JAX function to C99, to machine code and to a CUDA kernel."""

from .no_native_code import NoNativeCodeError as NoNativeCodeError
from .trace import trace as trace
