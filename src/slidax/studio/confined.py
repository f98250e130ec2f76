"""A process of the studio: the command line, or its workbench, that cannot leave the folder.

`python -P -m slidax.studio.confined FOLDER SCRATCH MODULE [ARGUMENTS]` calls `main` of the module. Three walls, each
for what the others let through: what files name is looked at before they are read (`references`); Python's own opens,
lists, moves and removals are refused elsewhere (here); and on Linux the kernel refuses the rest (`landlock`).
"""

from __future__ import annotations

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
"""What compilers, fonts and libraries of a system read; none of it is a user's."""

DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom", "/dev/random", "/dev/shm")

CHANGES = {
    "os.mkdir": 1,
    "os.remove": 1,
    "os.rmdir": 1,
    "os.truncate": 1,
    "os.chmod": 1,
    "os.chown": 1,
    "os.utime": 1,
    "os.rename": 2,
    "os.link": 2,
    "os.symlink": 2,
}
"""Python's events that change files, and how many paths each begins with."""

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


def readable() -> list[Path]:
    """Folders that Python and its packages are read from, and the system's."""
    python = [sys.prefix, sys.base_prefix, sys.exec_prefix, *sysconfig.get_paths().values(), *site.getsitepackages()]
    paths = [*python, *(path for path in sys.path if path and os.path.isdir(path)), *SYSTEM]
    return _real(paths)


def writable(root: Path, scratch: Path) -> list[Path]:
    """Folders that are written: the studio's, one for this process, and the caches of slidax and of its pictures.

    - `root`: the studio's folder.
    - `scratch`: of this process.
    """
    from platformdirs import user_cache_path

    caches = [user_cache_path("slidax"), user_cache_path("matplotlib")]
    for cache in caches:
        cache.mkdir(parents=True, exist_ok=True)
    return _real([root, scratch, *caches, *DEVICES])


def _real(paths: Iterable[Any]) -> list[Path]:
    found = {os.path.realpath(path) for path in paths}
    # A Python that was installed at the top would open everything.
    return [Path(path) for path in sorted(found) if path != os.sep and os.path.exists(path)]


class Watch:
    """Refuses what Python opens elsewhere.

    - `read`, `write`: folders and files.
    """

    def __init__(self, read: Iterable[Path], write: Iterable[Path]) -> None:
        self._write = tuple(str(path) for path in write)
        self._read = (*self._write, *(str(path) for path in read))

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Is told of every event of the interpreter.

        - `event`: its name.
        - `arguments`: its own.

        Raises PermissionError for what is outside.
        """
        if event == "open":
            path, mode, flags = arguments
            writes = (isinstance(mode, str) and any(one in mode for one in "wax+")) or bool((flags or 0) & WRITES)
            self._require(path, self._write if writes else self._read)
        elif event in ("os.listdir", "os.scandir"):
            self._require(arguments[0], self._read)
        elif event in CHANGES:
            for path in arguments[: CHANGES[event]]:
                # What is relative to an open folder was reached through it; that one was looked at when it was opened.
                if not any(isinstance(one, int) and one >= 0 for one in arguments[-2:]) or os.path.isabs(path):
                    self._require(path, self._write)
        elif event in ("socket.connect", "socket.bind") and isinstance(arguments[1], tuple):
            raise PermissionError(errno.EACCES, "the studio's processes open no connections")

    def _require(self, path: Any, allowed: tuple[str, ...]) -> None:
        if path is None or isinstance(path, int):
            return
        real = os.path.realpath(os.fsdecode(path))
        if not any(real == place or real.startswith(place + os.sep) for place in allowed):
            raise PermissionError(errno.EACCES, "it is outside of the studio's folder", os.fsdecode(path))


def confine(root: Path, scratch: Path) -> bool:
    """Gives up all but the folder. Whether the kernel holds it, too.

    - `root`: the studio's folder.
    - `scratch`: a folder of this process alone.
    """
    os.environ |= {"TMPDIR": str(scratch), "TEMP": str(scratch), "TMP": str(scratch), "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    read, write = readable(), writable(root, scratch)
    by_kernel = restrict_by_kernel(read, write)
    sys.addaudithook(Watch(read, write))
    return by_kernel


def restrict_by_kernel(read: list[Path], write: list[Path]) -> bool:
    """The kernel's wall, where there is one.

    - `read`, `write`: as of `Watch`.
    """
    from slidax.studio.landlock import restrict

    return restrict(read, write)


def main() -> None:
    """The process."""
    # Who interrupts it wants it to end, and no traceback; what can end better says so itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    root, scratch, module, *arguments = sys.argv[1:]
    os.chdir(root)
    confine(Path(root), Path(scratch))
    sys.argv = ["slidax", *arguments]
    import_module(module).main()


if __name__ == "__main__":
    main()
