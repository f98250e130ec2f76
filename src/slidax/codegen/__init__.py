"""From a pure JAX function to C99, to machine code and to a CUDA kernel.

`trace` makes a `Program` of the function; `c_code` and `cuda_code` print it, and `compile` makes machine code of it.
"""

from .c.function import function as c_code
from .cuda.kernel import kernel as cuda_code
from .ir import Program
from .llvm import Kernel, compile
from .no_native_code import NoNativeCodeError
from .trace import trace

__all__ = ["Kernel", "NoNativeCodeError", "Program", "c_code", "compile", "cuda_code", "trace"]
