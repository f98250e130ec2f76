"""Compile quickly at first, and with optimisation once a program has run for long."""

from __future__ import annotations

import os.path

from slidax.codegen.ir import Program
from slidax.codegen.no_native_code import in_one_line

from . import cache, machine
from .kernel import Kernel, identity

WORTHWHILE_TURNS = {1: 200_000, 8: 100_000}
"""Loop turns, by lanes, from which on optimised code saves time.

For a loop with seven joints, optimised code takes 7 s longer to compile, and then saves 14 µs per turn; with eight
lanes, 9 s and 70 µs. Both grow with the program, so the number of turns does not depend on its size. The total time is
at most about twice that of the better choice.
"""

STACK_LIMIT = 2_500_000
"""Largest size of the values in quick code, in bytes. The values take about half of that on the stack. A thread's stack
has 8 MB, on Windows 2 MB."""

VALUE_SIZE = 8
"""Bytes of one value in one lane."""


class ByDemand:
    """Quick and optimised code of a program; both give the same bits.

    - `program`: a program whose time is spent in a loop.
    - `lanes`: number of runs that are computed in parallel.
    """

    def __init__(self, program: Program, lanes: int = 1) -> None:
        self.program, self.lanes = program, lanes
        self._turns = 0
        self._identity: str | None = None
        self._kernel: Kernel | None = None

    def kernel(self, turns: int) -> Kernel:
        """Return the code that fits the number of turns so far.

        - `turns`: next turns of the loop; the runs in one vector count once.

        Raises DefinitionError if llvmlite is missing, or an operation of the program has no code.
        """
        first = self._kernel is None
        self._turns += turns
        worth = self._turns >= WORTHWHILE_TURNS.get(self.lanes, 0)
        if self._kernel is None or (worth and self._kernel.quick):
            with in_one_line(lambda: "the program"):
                self._identity = self._identity or identity(self.program, self.lanes)
            optimised = worth or (first and (self._is_cached(self._identity) or self._is_large()))
            self._kernel = Kernel(self.program, self.lanes, quick=not optimised, known=self._identity)
        return self._kernel

    def _is_cached(self, identity: str) -> bool:
        """True if the cache has optimised code."""
        key = machine.host().key_of(identity, machine.OPTIMISED)
        # Not `Path.is_file`, which raises where the folder is closed to this user.
        return os.path.isfile(cache.path_of(key))

    def _is_large(self) -> bool:
        """True if quick code might overflow the stack."""
        return sum(1 for _ in self.program.walk()) * VALUE_SIZE * self.lanes > STACK_LIMIT
