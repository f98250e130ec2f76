"""Confinement of a process to the studio's folder."""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import site
import sys
import sysconfig
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

SYSTEM = (
    *("/usr", "/lib", "/lib64", "/bin", "/opt", "/nix/store", "/System", "/Library"),
    *("/etc/ld.so.cache", "/etc/localtime", "/etc/fonts", "/etc/alternatives"),
    *("/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/filesystems", "/proc/self"),
    *("/proc/sys/vm/overcommit_memory", "/sys/devices/system", "/sys/fs/cgroup"),
)
"""Paths that compilers, fonts and system libraries read; none has files of a user."""

DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom", "/dev/random", "/dev/shm")

ENTRIES: dict[str, tuple[tuple[int, int], ...]] = {
    "os.mkdir": ((0, 2),),
    "os.remove": ((0, 1),),
    "os.rmdir": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)),
    "os.link": ((0, 2), (1, 3)),
    "os.symlink": ((1, 2),),
}
"""Audit events that change a folder: argument positions of each path and of the open folder to which it is relative."""

CONTENTS: dict[str, tuple[int, int | None]] = {
    "os.truncate": (0, None),
    "os.chmod": (0, 2),
    "os.chown": (0, 3),
    "os.utime": (0, 3),
    "os.chflags": (0, None),
    "os.setxattr": (0, None),
    "os.removexattr": (0, None),
}
"""Audit events that change a file: argument positions of its path or descriptor, and of the open folder."""

WITHOUT_EVENT = ("mkfifo", "mknod")
"""Functions that create files without an audit event."""

NAMES = ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr", "socket.getnameinfo")
"""Audit events that send a host name to the network."""

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def readable_folders() -> list[Path]:
    """Return the folders of Python, its packages and the system, which a confined process may read."""
    python = [sys.prefix, sys.base_prefix, sys.exec_prefix, *sysconfig.get_paths().values(), *site.getsitepackages()]
    paths = [*python, *(path for path in sys.path if path and os.path.isdir(path)), *SYSTEM]
    return _real(paths)


def writable_folders(root: Path, scratch: Path) -> list[Path]:
    """Return the paths that a confined process may write: `root`, `scratch`, two caches, and devices.

    The caches are those of slidax and matplotlib.

    - `root`: the studio's folder.
    - `scratch`: temporary folder of the process.
    """
    from platformdirs import user_cache_path

    caches = [user_cache_path("slidax"), user_cache_path("matplotlib")]
    for cache in caches:
        cache.mkdir(parents=True, exist_ok=True)
    return _real([root, scratch, *caches, *DEVICES])


def _real(paths: Iterable[Any]) -> list[Path]:
    real = {os.path.realpath(path) for path in paths}
    # A Python installed in the root folder must not open everything.
    return [Path(path) for path in sorted(real) if path != os.sep and os.path.exists(path)]


class Watch:
    """Audit hook that refuses access to files outside some folders, and network connections.

    - `read`: files and folders that may be read.
    - `write`: files and folders that may be read and written.
    """

    def __init__(self, read: Iterable[Path], write: Iterable[Path]) -> None:
        self._write = tuple(str(path) for path in write)
        self._read = (*self._write, *(str(path) for path in read))

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Raise PermissionError if an `event` with its `arguments` accesses anything outside the allowed folders."""
        if event == "open":
            path, mode, flags = arguments
            writes = (isinstance(mode, str) and any(letter in mode for letter in "wax+")) or bool((flags or 0) & WRITES)
            self._require(path, self._write if writes else self._read)
        elif event in ("os.listdir", "os.scandir"):
            self._require(arguments[0], self._read)
        elif event in ENTRIES:
            for path, folder in ENTRIES[event]:
                self._require_entry(arguments[path], arguments[folder])
            if event == "os.symlink":
                self._require_target(*arguments)
        elif event in CONTENTS:
            path, base = CONTENTS[event]
            self._require_content(arguments[path], -1 if base is None else arguments[base])
        elif event in ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"):
            self._require_address(arguments[1])
        elif event in NAMES:
            raise PermissionError(errno.EACCES, "processes of the studio must not look up addresses")

    def _require(self, path: Any, allowed: tuple[str, ...]) -> None:
        if path is None or isinstance(path, int):
            return
        _require_within(os.path.realpath(os.fsdecode(path)), path, allowed)

    def _require_entry(self, path: Any, folder: int) -> None:
        """Check a changed entry of a folder, without following a link in its last part."""
        absolute = _absolute(path, folder)
        head, name = os.path.split(absolute.rstrip(os.sep) or os.sep)
        if name in ("", os.curdir, os.pardir):
            real = os.path.realpath(absolute)
        else:
            real = os.path.join(os.path.realpath(head), name)
        _require_within(real, path, self._write)

    def _require_content(self, path: Any, folder: int) -> None:
        """Check a changed file: its name and its target, or the path of an open file."""
        if isinstance(path, int):
            real = _path_of(path)
            # Pipes and sockets have no path.
            if real is not None:
                _require_within(real, real, self._write)
            return
        self._require_entry(path, folder)
        _require_within(os.path.realpath(_absolute(path, folder)), path, self._write)

    def _require_target(self, target: Any, path: Any, folder: int) -> None:
        """Check that a new link does not lead outside."""
        around = os.path.dirname(_absolute(path, folder))
        _require_within(os.path.realpath(os.path.join(around, os.fsdecode(target))), target, self._write)

    def _require_address(self, address: Any) -> None:
        if isinstance(address, str | bytes):
            text = os.fsdecode(address)
            # A Unix socket with a path is a file; an abstract one is not.
            if text and not text.startswith("\0"):
                _require_within(os.path.realpath(text), text, self._write)
                return
        if address is not None:
            raise PermissionError(errno.EACCES, "processes of the studio must not open connections")


def _absolute(path: Any, folder: int) -> str:
    """Return the absolute path of a path relative to an open folder; a descriptor below 0 is the current folder."""
    text = os.fsdecode(path)
    if folder < 0 or os.path.isabs(text):
        return os.path.join(os.getcwd(), text)
    base = _path_of(folder)
    if base is None:
        raise PermissionError(errno.EACCES, "its folder is unknown", text)
    return os.path.join(base, text)


def _path_of(handle: int) -> str | None:
    """Return the path of an open file or folder; None for pipes, sockets and memory, or if unknown."""
    try:
        if sys.platform == "darwin":
            import fcntl

            return os.path.realpath(fcntl.fcntl(handle, fcntl.F_GETPATH, bytes(1024)).rstrip(b"\0").decode())
        path = os.readlink(f"/proc/self/fd/{handle}")
    except OSError:
        return None
    return path if path.startswith(os.sep) and not path.startswith("/memfd:") else None


def _require_within(real: str, path: Any, allowed: tuple[str, ...]) -> None:
    if not any(real == folder or real.startswith(folder + os.sep) for folder in allowed):
        raise PermissionError(errno.EACCES, "it is outside the studio's folder", os.fsdecode(path))


def _refuse(*arguments: Any, **named: Any) -> None:
    raise PermissionError(errno.EACCES, "processes of the studio must not create pipes or device files")


def confine(root: Path, scratch: Path) -> bool:
    """Limit this process to the folders that it needs; return True if the kernel enforces it.

    - `root`: the studio's folder.
    - `scratch`: temporary folder of the process.
    """
    os.environ |= {"TMPDIR": str(scratch), "TEMP": str(scratch), "TMP": str(scratch), "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    read, write = readable_folders(), writable_folders(root, scratch)
    by_kernel = restrict(read, write)
    for name in WITHOUT_EVENT:
        for module in (os, sys.modules[os.name]):
            if hasattr(module, name):
                setattr(module, name, _refuse)
    sys.addaudithook(Watch(read, write))
    return by_kernel


def main() -> None:
    """Confine this process, then call the `main` of the module in its arguments."""
    # An interrupt ends the process without a traceback; a job that can save its results sets its own handler.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    root, scratch, module, *arguments = sys.argv[1:]
    os.chdir(root)
    confine(Path(root), Path(scratch))
    sys.argv = ["slidax", *arguments]
    import_module(module).main()


CREATE, ADD, RESTRICT = 444, 445, 446
"""System call numbers of Landlock, equal on all CPU architectures."""

VERSION, BENEATH, NO_NEW_PRIVILEGES = 1, 1, 38

EXECUTE, WRITE, READ_FILE, READ_FOLDER = 1 << 0, 1 << 1, 1 << 2, 1 << 3
LOOK = EXECUTE | READ_FILE | READ_FOLDER
OF_FILES = EXECUTE | WRITE | READ_FILE | 1 << 14
"""Rights that apply to a file; the last is truncation."""

RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
"""Number of rights in each version of Landlock."""


class _Rules(ctypes.Structure):
    _fields_ = (("files", ctypes.c_uint64), ("ports", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def restrict(read: Iterable[Path], write: Iterable[Path]) -> bool:
    """Restrict this process's access to files by Linux's Landlock; return False if the kernel does not support it.

    From Landlock's version 4 on, the process can also no longer use TCP connections.

    - `read`: files and folders that the process may still read.
    - `write`: files and folders that the process may still read and write.
    """
    if sys.platform != "linux":
        return False
    kernel = ctypes.CDLL(None, use_errno=True)
    version = kernel.syscall(CREATE, None, ctypes.c_size_t(0), VERSION)
    if version < 1:
        return False
    all_rights = (1 << RIGHTS[min(version, max(RIGHTS))]) - 1
    # From version 4 on, also forbid binding and connecting to TCP ports.
    rules = _Rules(all_rights, 3 if version >= 4 else 0)
    size = ctypes.c_size_t(16 if version >= 4 else 8)
    handle = kernel.syscall(CREATE, ctypes.byref(rules), size, 0)
    if handle < 0:
        return False
    try:
        for paths, rights in ((read, LOOK), (write, all_rights)):
            for path in paths:
                _allow(kernel, handle, path, rights & all_rights)
        kernel.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
        return bool(kernel.syscall(RESTRICT, handle, 0) == 0)
    finally:
        os.close(handle)


def _allow(kernel: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    if sys.platform != "linux":
        return
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        allowed = rights if path.is_dir() else rights & OF_FILES
        kernel.syscall(ADD, rules, BENEATH, ctypes.byref(_Beneath(allowed, handle)), 0)
    finally:
        os.close(handle)


if __name__ == "__main__":
    main()
