"""Compile programs to machine code with LLVM.

`vectorise.py` prepares a program, `blocks.py` prints it, and `kernel.py` compiles and calls it.
"""

from .kernel import LANES as LANES
from .kernel import ByDemand as ByDemand
from .kernel import Kernel as Kernel
from .kernel import compile as compile
from .machine import available as available
