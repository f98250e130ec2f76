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

OPTIMISED = 2
"""LLVM's level for instruction selection, scheduling and registers."""


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
        # Not the model for JITs, which spells out the address of every constant.
        self.target: Any = llvm.Target.from_default_triple().create_target_machine(
            cpu=self.cpu, features=self.features, opt=OPTIMISED, reloc="pic", codemodel="small"
        )
        self.jit: Any = llvm.create_lljit_compiler(self.target, use_jit_link=True)
        self.numbers = itertools.count()

    def code_of(self, what: str, entry: str, text: Callable[[], str]) -> Code:
        """A module's code, from the disk if the same was compiled before.

        - `what`: all that the module depends on; printing it would take as long as compiling it.
        - `entry`: the name of its function.
        - `text`: gives the module.
        """
        key = "\n".join([self.version, self.cpu, self.features, str(OPTIMISED), what])
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
        made = self.compiled(text())
        cache.keep(key, made)
        return Code(self, made, entry)

    def compiled(self, text: str) -> bytes:
        """An object file made anew; what LLVM's passes could do is done beforehand.

        - `text`: of the module.
        """
        return bytes(self.target.emit_object(self.llvm.parse_assembly(text)))


@functools.cache
def host() -> Machine:
    """The machine, looked at once."""
    return Machine()
