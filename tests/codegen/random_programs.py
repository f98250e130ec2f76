"""Terminating programs of random operations, loops and branches, with exactly rounded operations only."""

from __future__ import annotations

import numpy as np

from slidax.codegen.builder import Builder

NUMBERS = ["add", "sub", "mul", "div", "min", "max"]
INTEGERS = ["add", "sub", "mul", "and", "or", "xor", "min", "max", "shl", "shr"]
COMPARED = ["lt", "le", "gt", "ge", "eq", "ne"]


class RandomProgram:
    """Builder of a random program."""

    def __init__(self, seed, size=16, varying=False):
        self.random = np.random.default_rng(seed)
        self.builder = Builder()
        self.size = size
        self.known = {"f64": [], "i32": [], "i64": [], "u32": [], "b1": []}
        for type in ("f64", "i32", "i64", "u32"):
            self.known[type] += list(self.builder.input(f"{type}s", type, (3,), varying=varying))
        self.known["f64"] += [self.builder.constant(x, "f64") for x in (0.0, -1.5, 1e-3)]
        self.known["i32"] += [self.builder.constant(k, "i32") for k in (-2, 3, -(2**31))]
        self.known["b1"].append(self.builder.apply("lt", *self.known["f64"][:2]))

    def pick(self, type):
        """Return a known value of a type, with a preference for recent values."""
        values = self.known[type]
        return values[-1 - min(int(self.random.exponential(6.0)), len(values) - 1)]

    def operation(self):
        """Add a value."""
        type = self.random.choice(["f64", "f64", "f64", "i32", "i64", "u32", "b1", "convert", "select"])
        if type == "f64":
            op = self.random.choice([*NUMBERS, "neg", "abs", "sqrt", "floor"])
            args = [self.pick("f64") for _ in range(2 if op in NUMBERS else 1)]
        elif type in ("i32", "i64", "u32"):
            op = self.random.choice([*INTEGERS, "neg", "not"] if type == "u32" else [*INTEGERS, "sar", "neg", "abs"])
            args = [self.pick(type) for _ in range(2 if op in INTEGERS or op == "sar" else 1)]
            if op in ("shl", "shr", "sar"):
                args[1] = self.builder.constant(int(self.random.integers(0, 31)), type)
        elif type == "b1":
            op = self.random.choice([*COMPARED, "and", "or", "xor", "not", "isfinite"])
            of = self.random.choice(["f64", "i32", "u32"]) if op in COMPARED else "b1"
            args = [self.pick("f64" if op == "isfinite" else of) for _ in range(1 if op in ("not", "isfinite") else 2)]
        elif type == "convert":
            of, type = self.random.choice(["f64", "i32", "u32", "b1", "i64"], 2)
            op, args = "convert", [self.pick(of)]
        else:
            type = self.random.choice(["f64", "i32", "b1"])
            op, args = "select", [self.pick("b1"), self.pick(type), self.pick(type)]
        value = self.builder.apply(str(op), *args, type=str(type))
        self.known[value.type].append(value)

    def region(self, depth):
        """Add several values, among them loops and branches."""
        for _ in range(int(self.random.integers(4, self.size if depth else 3 * self.size))):
            kind = self.random.random()
            if depth < 3 and kind < 0.08:
                self.branch(depth)
            elif depth < 3 and kind < 0.14:
                self.loop(depth)
            else:
                self.operation()

    def inside(self, make):
        """Forget the values of a block after it."""
        before = {type: list(values) for type, values in self.known.items()}
        values = make()
        self.known = before
        return values

    def leaves(self, types):
        return [self.pick(type) for type in types]

    def branch(self, depth):
        """Add a branch that returns some numbers."""
        types = [str(t) for t in self.random.choice(["f64", "i32", "b1"], int(self.random.integers(1, 4)))]

        def side():
            return self.inside(lambda: (self.region(depth + 1), self.leaves(types))[1])

        for result in self.builder.branch(self.pick("b1"), side, side):
            self.known[result.type].append(result)

    def loop(self, depth):
        """Add a loop with a few iterations, whose number may or may not be known at compile time."""
        types = [str(t) for t in self.random.choice(["f64", "i32", "b1"], int(self.random.integers(1, 4)))]
        zero, step = (self.builder.constant(k, "i32") for k in (0, 1))
        turns = self.builder.apply("and", self.pick("i32"), self.builder.constant(3, "i32"))
        known = bool(self.random.integers(2))
        start = [zero, *self.leaves(types)]
        unknown = self.pick("f64")

        def condition(carried):
            more = self.builder.apply("lt", carried[0], turns)
            if known:
                return more
            return self.builder.apply("and", more, self.builder.apply("ne", unknown, self.of(carried, "f64", unknown)))

        def body(carried):
            def make():
                for value in carried:
                    self.known[value.type].append(value)
                self.region(depth + 1)
                return [self.builder.apply("add", carried[0], step), *self.leaves(types)]

            return self.inside(make)

        for result in self.builder.loop(start, condition, body, turns if known else None):
            self.known[result.type].append(result)

    @staticmethod
    def of(values, type, otherwise):
        return next((value for value in values if value.type == type), otherwise)

    def finish(self):
        """The program."""
        self.region(0)
        for type in ("f64", "i32", "b1"):
            self.builder.output(type, type, np.array([self.pick(type) for _ in range(12)], object))
        return self.builder.finish()


def random_program(seed):
    """A program with inputs of 3 doubles, 3 int32, 3 int64 and 3 uint32."""
    return RandomProgram(seed).finish()


def random_arrays(seed):
    """Arrays for the inputs of a random program."""
    random = np.random.default_rng(seed)
    return [
        random.normal(size=3) * 3,
        random.integers(-(2**31), 2**31, 3, np.int32) >> random.integers(0, 30, 3, np.int32),
        random.integers(-(2**62), 2**62, 3, np.int64) >> random.integers(0, 60, 3, np.int64),
        random.integers(0, 2**32, 3, np.uint32),
    ]
