"""Compile a pure JAX function to C99, machine code, a CUDA kernel or WebAssembly.

`trace` converts the function to a `Program`, a list of scalar operations with loops and branches. `c_code` and
`cuda_code` print it as source, and `compile` compiles it to machine code. For a closed loop, native code, the engine
`cuda` and WebAssembly expand elementary functions such as sin into correctly rounded operations. Their results are then
bitwise equal, if the browser has a fused multiply-add. `c_code` and `cuda_code` call the target's library instead.

Read first: `ir.py`, then `trace/tracing.py`, `c/functions.py` and `llvm/kernel.py`.
"""

from .c.functions import c_code as c_code
from .cuda import cuda_code as cuda_code
from .ir import NoNativeCodeError as NoNativeCodeError
from .ir import Program as Program
from .llvm.kernel import Kernel as Kernel
from .llvm.kernel import compile as compile
from .trace.tracing import trace as trace
