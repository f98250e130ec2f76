"""Programs run by NumPy, operation by operation, on many samples at once: the reference for all code generators."""

from __future__ import annotations

import ctypes
import ctypes.util

import numpy as np
import scipy.special

from slidax.codegen.ir import DTYPES, Branch, Loop


def interpreted(program, *inputs):
    """The program's outputs, a list of arrays [samples, *shape]; logged outputs are [samples, rows, *shape]."""
    samples = len(inputs[0]) if inputs else 1
    run = _Run(program, [np.asarray(x).reshape(samples, -1) for x in inputs], samples)
    with np.errstate(all="ignore"):
        run.region(program.body, np.ones(samples, bool))
    return [run.output(k, output) for k, output in enumerate(program.outputs)]


class _Run:
    """The values computed so far."""

    def __init__(self, program, inputs, samples):
        self.program = program
        self.inputs = inputs
        self.samples = samples
        self.known = {}
        self.logged = {k: {} for k, output in enumerate(program.outputs) if output.values is None}

    def __getitem__(self, value):
        return self.known[value]

    def region(self, region, active):
        """Compute a region; store only where `active`."""
        for value in region.values:
            if isinstance(value, Loop):
                self.loop(value, active)
            elif isinstance(value, Branch):
                self.branch(value, active)
            elif value.op == "store":
                self.store(value, active)
            elif value.op != "param":
                self.known[value] = self.computed(value)

    def computed(self, value):
        dtype = DTYPES[value.type]
        if value.op == "const":
            return np.full(self.samples, value.data, dtype)
        if value.op == "input":
            which, element = value.data
            return self.inputs[which][:, element].astype(dtype)
        if value.op == "load":
            return self.inputs[value.data][np.arange(self.samples), self[value.args[0]]].astype(dtype)
        if value.op == "result":
            return self.known[value.args[0]][value.data]
        args = [self[arg] for arg in value.args]
        if value.op == "convert":
            return converted(args[0], dtype)
        if value.op == "bitcast":
            return args[0].view(dtype)
        result = OPERATIONS[value.op](*args)
        assert result.dtype == dtype, value
        return result

    def loop(self, loop, active):
        carried = [self[arg] for arg in loop.args]
        turning = active
        while True:
            self.known.update(zip(loop.params, carried, strict=True))
            self.region(loop.head, turning)
            turning = turning & self[loop.condition]
            if not turning.any():
                break
            self.region(loop.body, turning)
            following = [self[value] for value in loop.following]
            carried = [np.where(turning, new, old) for new, old in zip(following, carried, strict=True)]
        self.known[loop] = carried

    def branch(self, branch, active):
        when = self[branch.args[0]]
        self.region(branch.then, active & when)
        self.region(branch.otherwise, active & ~when)
        self.known[branch] = [
            np.where(when, self[yes], self[no]) for yes, no in zip(branch.yes, branch.no, strict=True)
        ]

    def store(self, store, active):
        row, when, *numbers = [self[arg] for arg in store.args]
        numbers = np.stack(numbers, axis=1) if numbers else np.zeros((self.samples, 0))
        for sample in np.flatnonzero(active & when):
            self.logged[store.data][sample, int(row[sample])] = numbers[sample]

    def output(self, k, output):
        dtype = DTYPES[output.type]
        if output.values is not None:
            columns = [self[value].astype(dtype) for value in output.values]
            flat = np.stack(columns, axis=1) if columns else np.zeros((self.samples, 0), dtype)
            return flat.reshape(self.samples, *output.shape)
        rows = 1 + max((row for _, row in self.logged[k]), default=-1)
        array = np.zeros((self.samples, rows, output.size), dtype)
        for (sample, row), numbers in self.logged[k].items():
            array[sample, row] = numbers
        return array.reshape(self.samples, rows, *output.shape)


def converted(x, dtype):
    """Convert to another type: floats round towards zero and saturate as integers; NaN becomes 0."""
    if x.dtype.kind != "f" or np.dtype(dtype).kind not in "iu":
        return x.astype(dtype)
    ends = np.iinfo(dtype)
    # The upper end may not be a float; the next power of two always is.
    above = x >= float(ends.max + 1)
    below = x <= float(ends.min)
    inside = np.where(above | below | np.isnan(x), 0, x).astype(dtype)
    return np.where(above, dtype(ends.max), np.where(below, dtype(ends.min), inside))


_libm = ctypes.CDLL(ctypes.util.find_library("m"))
_libm.fma.argtypes, _libm.fma.restype = [ctypes.c_double] * 3, ctypes.c_double
_libm.fmaf.argtypes, _libm.fmaf.restype = [ctypes.c_float] * 3, ctypes.c_float
_fma, _fmaf = np.frompyfunc(_libm.fma, 3, 1), np.frompyfunc(_libm.fmaf, 3, 1)


def fma(a, b, c):
    """`a b + c`, rounded once, by the C library."""
    return (_fmaf if a.dtype == np.float32 else _fma)(a, b, c).astype(a.dtype)


def _divided(x, y):
    if x.dtype.kind == "f":
        return x / y
    quotient = np.abs(x) // np.where(y == 0, 1, np.abs(y))
    return np.where((x < 0) != (y < 0), -quotient, quotient).astype(x.dtype)


def _shifted_right(x, by):
    unsigned = x.view(np.dtype(f"u{x.dtype.itemsize}"))
    return (unsigned >> by.astype(unsigned.dtype)).view(x.dtype)


OPERATIONS = {
    **{
        name: getattr(np, name)
        for name in ["abs", "sqrt", "floor", "ceil", "rint", "exp", "expm1", "log", "log1p", "sin", "cos", "tan"]
    },
    **{name: getattr(np, name) for name in ["sinh", "cosh", "tanh", "cbrt", "isfinite"]},
    **{name: getattr(np, "arc" + name[1:]) for name in ("asin", "acos", "atan", "atan2")},
    **{"add": np.add, "sub": np.subtract, "mul": np.multiply, "div": _divided, "rem": np.fmod, "neg": np.negative},
    **{"min": np.minimum, "max": np.maximum, "fma": fma, "pow": np.power, "select": np.where},
    **{"and": np.bitwise_and, "or": np.bitwise_or, "xor": np.bitwise_xor, "not": np.invert},
    **{"shl": np.left_shift, "shr": _shifted_right, "sar": np.right_shift},
    **{"erf": scipy.special.erf, "erf_inv": scipy.special.erfinv},
    **{"eq": np.equal, "ne": np.not_equal, "lt": np.less, "le": np.less_equal},
    **{"gt": np.greater, "ge": np.greater_equal},
}
