"""From LLVM's text to code that runs, for the processor at hand."""

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
"""LLVM's levels for instruction selection, scheduling and registers. They change no bit of a result."""


def available() -> bool:
    """Whether llvmlite is installed, which brings LLVM."""
    return find_spec("llvmlite") is not None


class Code:
    """Machine code in memory, as long as this object lives.

    - `machine`: what it is for.
    - `object`: an object file.
    - `entry`: the name of its function.

    Raises RuntimeError or IndexError if the object file has no such function.
    """

    def __init__(self, machine: Machine, object: bytes, entry: str) -> None:
        name = f"slidax{next(machine.numbers)}"
        builder = machine.llvm.JITLibraryBuilder().add_object_img(object).add_current_process().export_symbol(entry)
        self._library = builder.link(machine.jit, name)
        self.address: int = self._library[entry]
        self.object, self.entry = object, entry


class Machine:
    """The processor that this process runs on, with what it can do."""

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

    def key_of(self, what: str, level: int) -> str:
        """What code on the disk is found by: all that it depends on.

        - `what`: all that the module depends on; printing it would take as long as compiling it.
        - `level`: LLVM's.
        """
        return "\n".join([self.version, self.cpu, self.features, str(level), what])

    def code_of(self, what: str, entry: str, text: Callable[[], str], level: int) -> Code:
        """A module's code, from the disk if the same was compiled before.

        - `what`: as in `key_of`.
        - `entry`: the name of its function.
        - `text`: gives the module.
        - `level`: LLVM's.
        """
        key = self.key_of(what, level)
        kept = cache.kept(key)
        if kept is not None:
            try:
                return Code(self, kept, entry)
            except Exception as error:
                said = f"{type(error).__name__}: {error}".partition("\n")[0]
                warnings.warn(
                    f"`{cache.path_of(key)}` holds other code than that of this program ({said}); it is compiled anew",
                    stacklevel=2,
                )
        made = self.compiled(text(), level)
        cache.keep(key, made)
        return Code(self, made, entry)

    def compiled(self, text: str, level: int) -> bytes:
        """An object file made anew; what LLVM's passes could do is done beforehand.

        - `text`: of the module.
        - `level`: LLVM's.
        """
        return bytes(self._target(level).emit_object(self.llvm.parse_assembly(text)))

    def _target(self, level: int) -> Any:
        # Not the model for JITs, which spells out the address of every constant.
        return self.llvm.Target.from_default_triple().create_target_machine(
            cpu=self.cpu, features=self.features, opt=level, reloc="pic", codemodel="small"
        )


@functools.cache
def host() -> Machine:
    """The machine, looked at once."""
    return Machine()
