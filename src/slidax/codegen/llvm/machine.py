"""Compile LLVM IR for the processor of this machine."""

from __future__ import annotations

import functools
import itertools
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from slidax._errors import DefinitionError

from . import cache

QUICK, OPTIMISED = 0, 2
"""LLVM's optimisation levels for instruction selection, scheduling and registers. Results do not depend on them."""


def available() -> bool:
    """True if llvmlite is installed, which contains LLVM."""
    return find_spec("llvmlite") is not None


class Code:
    """Machine code in memory, valid as long as this object exists.

    - `object`: an object file.
    - `entry`: name of its function.

    Raises RuntimeError or IndexError if the object file has no such function.
    """

    def __init__(self, machine: Machine, object: bytes, entry: str) -> None:
        name = f"slidax{next(machine.numbers)}"
        builder = machine.llvm.JITLibraryBuilder().add_object_img(object).add_current_process().export_symbol(entry)
        self._library = builder.link(machine.jit, name)
        self.address: int = self._library[entry]
        self.object, self.entry = object, entry


class Machine:
    """The processor of this process, and its features."""

    def __init__(self) -> None:
        if not available():
            raise DefinitionError('machine code needs llvmlite, which is not installed: pip install "slidax[native]"')
        import llvmlite
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        self.llvm: Any = llvm
        self.cpu: str = llvm.get_host_cpu_name()
        self.features: str = llvm.get_host_cpu_features().flatten()
        self.version = f"llvmlite {llvmlite.__version__}, LLVM {llvm.llvm_version_info}"
        self.jit: Any = llvm.create_lljit_compiler(self._target(OPTIMISED), use_jit_link=True)
        self.numbers = itertools.count()

    def key_of(self, source: str, level: int) -> str:
        """Return the cache key of a module's code.

        - `source`: all that the module depends on; its IR would take as long to generate as to compile.
        - `level`: LLVM's optimisation level.
        """
        return "\n".join([self.version, self.cpu, self.features, str(level), source])

    def code_of(self, source: str, entry: str, text: Callable[[], str], level: int) -> Code:
        """Return a module's code, from the cache if possible.

        - `source`, `level`: as in `key_of`.
        - `entry`: name of its function.
        - `text`: generates the module's IR.
        """
        key = self.key_of(source, level)
        object = cache.load_code(key)
        if object is not None:
            try:
                return Code(self, object, entry)
            except Exception as error:
                reason = f"{type(error).__name__}: {error}".partition("\n")[0]
                warnings.warn(
                    f"`{cache.path_of(key)}` is not the code of this program ({reason}); it is compiled again",
                    stacklevel=2,
                )
        object = self.compiled(text(), level)
        cache.store_code(key, object)
        return Code(self, object, entry)

    def compiled(self, text: str, level: int) -> bytes:
        """Compile a module's IR to an object file, without LLVM's passes, which the IR does not need."""
        return bytes(self._target(level).emit_object(self.llvm.parse_assembly(text)))

    def _target(self, level: int) -> Any:
        # Not the code model for JITs, which writes out the address of every constant.
        return self.llvm.Target.from_default_triple().create_target_machine(
            cpu=self.cpu, features=self.features, opt=level, reloc="pic", codemodel="small"
        )


@functools.cache
def host() -> Machine:
    """Return the machine, inspected once."""
    return Machine()
