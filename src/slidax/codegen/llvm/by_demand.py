"""Code that is made quickly at first, and well once much is asked of it."""

from __future__ import annotations

import os.path

from slidax.codegen.ir import Program
from slidax.codegen.no_native_code import in_one_line

from . import cache, machine
from .kernel import Kernel, identity

WORTH = {1: 200_000, 8: 100_000}
"""Turns of a loop, by lanes, that are worth the time that good code takes to make.

For the loop of seven joints, good code takes 7 s longer to make, and then saves 14 us a turn, with eight lanes 9 s and
70 us. Both grow as the program does, so that the number of turns does not depend on its size. Whoever asks again and
again pays at most about twice what he would have, had he known.
"""

STACK = 2_500_000
"""Bytes that the values of quick code may have. They lie on the stack, where they take about half of that; threads have
8 MB, on Windows 2."""

NUMBER = 8
"""Bytes of one value in one lane."""


class ByDemand:
    """A program's code in two forms, which give the same bits.

    - `program`: what it computes; what takes time in it is a loop.
    - `lanes`: as many runs are computed side by side in vectors.
    """

    def __init__(self, program: Program, lanes: int = 1) -> None:
        self.program, self.lanes = program, lanes
        self._asked = 0
        self._identity: str | None = None
        self._kernel: Kernel | None = None

    def kernel(self, turns: int) -> Kernel:
        """The form that goes best with what is asked, now and before.

        - `turns`: how many turns of the loop, those of the runs in one vector counted once.

        Raises DefinitionError if llvmlite is missing, or the program asks for what there is no code for.
        """
        first = self._kernel is None
        self._asked += turns
        worth = self._asked >= WORTH.get(self.lanes, 0)
        if self._kernel is None or (worth and self._kernel.quick):
            with in_one_line(lambda: "the program"):
                self._identity = self._identity or identity(self.program, self.lanes)
            well = worth or (first and (self._made(self._identity) or self._large()))
            self._kernel = Kernel(self.program, self.lanes, quick=not well, known=self._identity)
        return self._kernel

    def _made(self, identity: str) -> bool:
        """Whether good code is on the disk from another time."""
        key = machine.host().key_of(identity, machine.OPTIMISED)
        # Not `Path.is_file`, which raises where the folder is closed to this user.
        return os.path.isfile(cache.path_of(key))

    def _large(self) -> bool:
        """Whether quick code might take more of the stack than there is."""
        return sum(1 for _ in self.program.walk()) * NUMBER * self.lanes > STACK
