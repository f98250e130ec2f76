"""Programs run by NumPy, operation by operation, on many samples at once: the meaning that printers are held to."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import scipy.special

from slidax.codegen.fold import DTYPES
from slidax.codegen.ir import Branch, Loop

SPLITTER = 2.0**27 + 1.0


def interpreted(program, *inputs):
    """The program's outputs, a list of arrays [samples, *shape]; logged ones [samples, rows, *shape]."""
    samples = len(inputs[0]) if inputs else 1
    run = _Run(program, [np.asarray(x).reshape(samples, -1) for x in inputs], samples)
    with np.errstate(all="ignore"):
        run.region(program.body, np.ones(samples, bool))
    return [run.output(k, output) for k, output in enumerate(program.outputs)]


class _Run:
    """The values that are known so far."""

    def __init__(self, program, inputs, samples):
        self.program = program
        self.inputs = inputs
        self.samples = samples
        self.known = {}
        self.logged = {k: {} for k, output in enumerate(program.outputs) if output.values is None}

    def __getitem__(self, value):
        return self.known[value]

    def region(self, region, active):
        """Computes a region; stores happen only where `active`."""
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
    """As another type: floats to integers towards zero, held at its ends, NaN to 0."""
    if x.dtype.kind != "f" or np.dtype(dtype).kind not in "iu":
        return x.astype(dtype)
    ends = np.iinfo(dtype)
    # The upper end itself may be no float; the next power of two always is.
    above = x >= float(ends.max + 1)
    below = x <= float(ends.min)
    inside = np.where(above | below | np.isnan(x), 0, x).astype(dtype)
    return np.where(above, dtype(ends.max), np.where(below, dtype(ends.min), inside))


def fma(a, b, c):
    """`a b + c`, rounded once."""
    if a.dtype == np.float32:
        product = a.astype(np.float64) * b
        return _to_odd(*_two_sum(product, c.astype(np.float64))).astype(np.float32)
    result = a * b + c
    plain = (a == 0) | (b == 0) | ~np.isfinite(a) | ~np.isfinite(b)
    magnitudes = [np.abs(x) for x in (a, b, c)]
    moderate = np.logical_and.reduce(
        [(x > 2.0**-400) & (x < 2.0**400) | (x == 0) for x in magnitudes] + [~plain], dtype=bool
    )
    k = np.flatnonzero(moderate)
    result[k] = _moderate_fma(a[k], b[k], c[k])
    for k in np.flatnonzero(~plain & ~moderate):
        result[k] = _slow_fma(float(a[k]), float(b[k]), float(c[k]))
    return result


def _moderate_fma(a, b, c):
    # The parts of the product and the sum, added so that the last rounding is the only one (Boldo and Melquiond, 2008).
    high = a * b
    low = _product_error(a, b, high)
    top, rest = _two_sum(c, low)
    total, error = _two_sum(high, top)
    return total + _to_odd(*_two_sum(rest, error))


def _slow_fma(a, b, c):
    if not np.isfinite(c):
        return c
    exact = Fraction(a) * Fraction(b) + Fraction(c)
    if exact == 0:
        return a * b + c
    try:
        return float(exact)
    except OverflowError:
        return np.inf if exact > 0 else -np.inf


def _two_sum(a, b):
    total = a + b
    added = total - a
    return total, (a - (total - added)) + (b - added)


def _product_error(a, b, product):
    def split(x):
        high = SPLITTER * x
        high = high - (high - x)
        return high, x - high

    (a1, a2), (b1, b2) = split(a), split(b)
    return ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2


def _to_odd(rounded, error):
    """The sum of both, inexact ones rounded to the neighbour whose last bit is set."""
    even = (rounded.view(np.int64) & 1) == 0
    return np.where((error != 0) & even, np.nextafter(rounded, np.copysign(np.inf, error)), rounded)


def _divided(x, y):
    if x.dtype.kind == "f":
        return x / y
    quotient = np.abs(x) // np.where(y == 0, 1, np.abs(y))
    return np.where((x < 0) != (y < 0), -quotient, quotient).astype(x.dtype)


def _shifted_right(x, by):
    unsigned = x.view(np.dtype(f"u{x.dtype.itemsize}"))
    return (unsigned >> by.astype(unsigned.dtype)).view(x.dtype)


OPERATIONS = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _divided,
    "rem": np.fmod,
    "neg": np.negative,
    "abs": np.abs,
    "min": np.minimum,
    "max": np.maximum,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "xor": np.bitwise_xor,
    "not": np.invert,
    "shl": np.left_shift,
    "shr": _shifted_right,
    "sar": np.right_shift,
    "fma": fma,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "ceil": np.ceil,
    "rint": np.rint,
    "exp": np.exp,
    "expm1": np.expm1,
    "log": np.log,
    "log1p": np.log1p,
    "pow": np.power,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "erf": scipy.special.erf,
    "erf_inv": scipy.special.erfinv,
    "cbrt": np.cbrt,
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "select": np.where,
    "isfinite": np.isfinite,
}
