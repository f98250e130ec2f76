"""Machine code for this CPU, with a cache on disk."""

from __future__ import annotations

import functools
import hashlib
import itertools
import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from slidax.core.errors import DefinitionError

DIGEST = 32
"""Length of the checksum at the beginning of a cache file [bytes]."""


def folder() -> Path:
    """Return the folder of the cache of compiled code, in the user's cache folder."""
    from platformdirs import user_cache_path

    return user_cache_path("slidax") / "native"


def path_of(key: str) -> Path:
    """Return the path of the cache file for a key, a text with everything on which the object code depends."""
    return folder() / f"{hashlib.sha256(key.encode()).hexdigest()}.o"


def load_code(key: str) -> bytes | None:
    """Return the object code for a key from the cache on disk.

    Returns None if it is missing or damaged, or if other users could change it.
    """
    path = path_of(key)
    try:
        if not path.parent.is_dir() or not _is_private(path.parent):
            return None
        handle = os.open(path, os.O_RDONLY | _BINARY | _NO_FOLLOW)
        with os.fdopen(handle, "rb") as file:
            if _fault(os.fstat(file.fileno()), stat.S_ISREG):
                return None
            data = file.read()
    except OSError:
        return None
    body = data[DIGEST:]
    return body if _checksum(key, body) == data[:DIGEST] else None


def store_code(key: str, body: bytes) -> None:
    """Store object code for a key in the cache on disk, if its folder is writable and no other user can change it."""
    path = path_of(key)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(path.parent):
            return
        # Write to a temporary file first, so that no process reads an incomplete one.
        handle, name = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_checksum(key, body) + body)
            os.replace(name, path)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        pass  # the next process compiles again


_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_BINARY = getattr(os, "O_BINARY", 0)


def _checksum(key: str, body: bytes) -> bytes:
    """Checksum of key and code, which also rejects a file under another key's name."""
    return hashlib.sha256(f"{key}\n".encode() + body).digest()


def _is_private(folder: Path) -> bool:
    """True if the folder can be used; warns if not. First removes other users' access to the user's own folder."""
    status = os.lstat(folder)
    own = hasattr(os, "getuid") and stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    if own and stat.S_IMODE(status.st_mode) != 0o700:
        os.chmod(folder, 0o700)
        status = os.lstat(folder)
    fault = _fault(status, stat.S_ISDIR)
    if fault:
        warnings.warn(
            f"native code is not cached on disk, because `{folder}` {fault}: delete it, or correct owner and access",
            stacklevel=2,
        )
    return not fault


def _fault(status: os.stat_result, is_kind: Callable[[int], bool]) -> str:
    """Return the reason not to use a folder or file; empty if there is none."""
    if stat.S_ISLNK(status.st_mode):
        return "is a symbolic link"
    if not is_kind(status.st_mode):
        return "has the wrong file type"
    if not hasattr(os, "getuid"):
        # Windows: the folder is in the user's profile, which is closed to others by default.
        return ""
    if status.st_uid != os.getuid():
        return "belongs to another user"
    return "may be written by other users" if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else ""


QUICK, OPTIMISED = 0, 2
"""LLVM's optimisation levels for instruction selection, scheduling and registers. Results do not depend on them."""


def available() -> bool:
    """True if llvmlite is installed, which contains LLVM."""
    return find_spec("llvmlite") is not None


class Code:
    """Machine code in memory, as long as this object exists; `address` is the address of its function.

    - `machine`: the CPU and its compiler, which links the code.
    - `object`: content of an object file, as bytes.
    - `entry`: name of the function in the object file.

    Raises RuntimeError or IndexError if the object file has no such function.
    """

    def __init__(self, machine: Machine, object: bytes, entry: str) -> None:
        name = f"slidax{next(machine.numbers)}"
        builder = machine.llvm.JITLibraryBuilder().add_object_img(object).add_current_process().export_symbol(entry)
        self._library = builder.link(machine.jit, name)
        self.address: int = self._library[entry]
        self.object, self.entry = object, entry


class Machine:
    """The CPU of this machine with its features, and LLVM's compiler for it.

    Raises DefinitionError if llvmlite is missing.
    """

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
        """Return the cache key for the machine code of an LLVM module.

        - `source`: text on which everything in the module depends. The module's IR is not in the key, since to generate
          it takes as long as to compile it.
        - `level`: LLVM's optimisation level.
        """
        return "\n".join([self.version, self.cpu, self.features, str(level), source])

    def code_of(self, source: str, entry: str, text: Callable[[], str], level: int) -> Code:
        """Return the machine code of an LLVM module: from the cache on disk, else compiled and then stored there.

        - `source`, `level`: as in `key_of`.
        - `entry`: name of the module's function.
        - `text`: function that returns the module's LLVM IR, called only if the cache has no code.
        """
        key = self.key_of(source, level)
        object = load_code(key)
        if object is not None:
            try:
                return Code(self, object, entry)
            except Exception as error:
                reason = f"{type(error).__name__}: {error}".partition("\n")[0]
                warnings.warn(
                    f"`{path_of(key)}` is not the code of this program ({reason}); the program is compiled again",
                    stacklevel=2,
                )
        object = self.compiled(text(), level)
        store_code(key, object)
        return Code(self, object, entry)

    def compiled(self, text: str, level: int) -> bytes:
        """Compile LLVM IR, without LLVM's optimisation passes on the IR; return the bytes of the object file."""
        return bytes(self._target(level).emit_object(self.llvm.parse_assembly(text)))

    def _target(self, level: int) -> Any:
        # The code model for JITs would write out the address of every constant.
        return self.llvm.Target.from_default_triple().create_target_machine(
            cpu=self.cpu, features=self.features, opt=level, reloc="pic", codemodel="small"
        )


@functools.cache
def host() -> Machine:
    """Return this machine and its compiler; the CPU is inspected only once."""
    return Machine()
