"""Compile programs to machine code with LLVM."""

from .by_demand import ByDemand as ByDemand
from .kernel import LANES as LANES
from .kernel import Kernel as Kernel
from .kernel import compile as compile
from .machine import available as available

__all__ = ["LANES", "ByDemand", "Kernel", "available", "compile"]
