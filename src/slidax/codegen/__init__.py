"""From a pure JAX function to C99, to machine code, to a CUDA kernel and to WebAssembly.

`trace` makes a `Program` of the function. `c_code` and `cuda_code` print it, and `compile` makes machine code of it.
All of them write elementary functions out in exactly rounded operations, so that each target gives the same bits.

Read first: `ir.py`, then `trace/tracing.py`, `c/functions.py` and `llvm/kernel.py`.
"""

from .c.functions import c_code as c_code
from .cuda.source import cuda_code as cuda_code
from .ir import NoNativeCodeError as NoNativeCodeError
from .ir import Program as Program
from .llvm.kernel import Kernel as Kernel
from .llvm.kernel import compile as compile
from .trace.tracing import trace as trace
