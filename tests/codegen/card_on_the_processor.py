"""CUDA kernels on the CPU, compiled as C++ and run thread by thread, for machines without a GPU."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from slidax.codegen import cuda
from slidax.codegen.cuda import dtype_on_card, pack_inputs, unpack_outputs

THREADS = 4
"""Threads of a block, so that some threads of the last block have no run."""

# Definitions of CUDA's keywords for a C++ compiler; threads run one at a time.
ON_THE_PROCESSOR = """
#include <cmath>
#include <cstring>
using std::isnan;
using std::isfinite;
#define __global__
#define __device__
static struct { long long x; } blockIdx, blockDim, threadIdx;
static inline double __longlong_as_double(long long bits) { double x; std::memcpy(&x, &bits, 8); return x; }
static inline float __int_as_float(int bits) { float x; std::memcpy(&x, &bits, 4); return x; }
extern "C" void choose(long long block, long long threads, long long thread)
{
    blockIdx.x = block;
    blockDim.x = threads;
    threadIdx.x = thread;
}
"""

needs_gxx = pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not installed")


class CardOnTheProcessor(cuda.CudaKernel):
    """A kernel that needs no CuPy."""

    def __init__(self, program, folder: Path, real="double"):
        source, library = folder / "kernel.cpp", folder / "kernel.so"
        source.write_text(ON_THE_PROCESSOR + cuda.cuda_code(program, real=real))
        options = ["-std=c++17", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
        subprocess.run(["g++", *options, str(source), "-o", str(library)], check=True)
        self.program, self.real = program, real
        self.code = ctypes.CDLL(str(library))

    def batch(self, inputs, runs, rows=0):
        packed = pack_inputs(self.program, inputs, runs, self.real)
        left = [
            np.zeros((rows if entry.values is None else 1, entry.size, runs), dtype_on_card(entry.type, self.real))
            for entry in self.program.outputs
        ]
        places = [ctypes.c_void_p(array.ctypes.data) for array in (*packed, *left)]
        for run in range(-(-runs // THREADS) * THREADS):
            self.code.choose(*[ctypes.c_longlong(k) for k in (run // THREADS, THREADS, run % THREADS)])
            self.code.run_all(*places, ctypes.c_longlong(runs))
        return unpack_outputs(self.program, left)
