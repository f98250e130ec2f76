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

ENTRIES: dict[str, tuple[tuple[int, int], ...]] = {
    "os.mkdir": ((0, 2),),
    "os.remove": ((0, 1),),
    "os.rmdir": ((0, 1),),
    "os.rename": ((0, 2), (1, 3)),
    "os.link": ((0, 2), (1, 3)),
    "os.symlink": ((1, 2),),
}
"""Python's events that change a folder: places of each path, and of the open folder that it is relative to."""

CONTENTS: dict[str, tuple[int, int | None]] = {
    "os.truncate": (0, None),
    "os.chmod": (0, 2),
    "os.chown": (0, 3),
    "os.utime": (0, 3),
    "os.chflags": (0, None),
    "os.setxattr": (0, None),
    "os.removexattr": (0, None),
}
"""Python's events that change a file, by its path or its descriptor: places of these, and of an open folder."""

WITHOUT_EVENT = ("mkfifo", "mknod")
"""Functions that make files and tell no audit hook."""

NAMES = ("socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr", "socket.getnameinfo")
"""Events in which a name goes to the network."""

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
        elif event in ENTRIES:
            for place, folder in ENTRIES[event]:
                self._require_entry(arguments[place], arguments[folder])
            if event == "os.symlink":
                self._require_target(*arguments)
        elif event in CONTENTS:
            place, base = CONTENTS[event]
            self._require_content(arguments[place], -1 if base is None else arguments[base])
        elif event in ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"):
            self._require_address(arguments[1])
        elif event in NAMES:
            raise PermissionError(errno.EACCES, "the studio's processes look up no addresses")

    def _require(self, path: Any, allowed: tuple[str, ...]) -> None:
        if path is None or isinstance(path, int):
            return
        _require_within(os.path.realpath(os.fsdecode(path)), path, allowed)

    def _require_entry(self, path: Any, folder: int) -> None:
        """The place of a name in its folder, whatever it leads to."""
        whole = _at(path, folder)
        head, name = os.path.split(whole.rstrip(os.sep) or os.sep)
        if name in ("", os.curdir, os.pardir):
            real = os.path.realpath(whole)
        else:
            real = os.path.join(os.path.realpath(head), name)
        _require_within(real, path, self._write)

    def _require_content(self, path: Any, folder: int) -> None:
        """A file that is changed: its name and the place that it leads to, or the place of an open one."""
        if isinstance(path, int):
            real = _opened(path)
            # Pipes and sockets are no files.
            if real is not None:
                _require_within(real, real, self._write)
            return
        self._require_entry(path, folder)
        _require_within(os.path.realpath(_at(path, folder)), path, self._write)

    def _require_target(self, target: Any, path: Any, folder: int) -> None:
        """A new link leads nowhere else."""
        around = os.path.dirname(_at(path, folder))
        _require_within(os.path.realpath(os.path.join(around, os.fsdecode(target))), target, self._write)

    def _require_address(self, address: Any) -> None:
        if isinstance(address, str | bytes):
            text = os.fsdecode(address)
            # A socket with a path is a file; one without has no place.
            if text and not text.startswith("\0"):
                _require_within(os.path.realpath(text), text, self._write)
                return
        if address is not None:
            raise PermissionError(errno.EACCES, "the studio's processes open no connections")


def _at(path: Any, folder: int) -> str:
    """A path from the open folder that it is relative to; a number below 0 is the current one."""
    text = os.fsdecode(path)
    if folder < 0 or os.path.isabs(text):
        return os.path.join(os.getcwd(), text)
    base = _opened(folder)
    if base is None:
        raise PermissionError(errno.EACCES, "its folder is not known", text)
    return os.path.join(base, text)


def _opened(handle: int) -> str | None:
    """The place of an open file or folder; None for pipes, sockets, memory, and where the system does not say."""
    try:
        if sys.platform == "darwin":
            import fcntl

            return os.path.realpath(fcntl.fcntl(handle, fcntl.F_GETPATH, bytes(1024)).rstrip(b"\0").decode())
        place = os.readlink(f"/proc/self/fd/{handle}")
    except OSError:
        return None
    return place if place.startswith(os.sep) and not place.startswith("/memfd:") else None


def _require_within(real: str, path: Any, allowed: tuple[str, ...]) -> None:
    if not any(real == place or real.startswith(place + os.sep) for place in allowed):
        raise PermissionError(errno.EACCES, "it is outside of the studio's folder", os.fsdecode(path))


def _refuse(*arguments: Any, **named: Any) -> None:
    raise PermissionError(errno.EACCES, "the studio's processes make no such files")


def confine(root: Path, scratch: Path) -> bool:
    """Gives up all but the folder. Whether the kernel holds it, too.

    - `root`: the studio's folder.
    - `scratch`: a folder of this process alone.
    """
    os.environ |= {"TMPDIR": str(scratch), "TEMP": str(scratch), "TMP": str(scratch), "PYTHONDONTWRITEBYTECODE": "1"}
    sys.dont_write_bytecode = True
    read, write = readable(), writable(root, scratch)
    by_kernel = restrict_by_kernel(read, write)
    for name in WITHOUT_EVENT:
        for module in (os, sys.modules[os.name]):
            if hasattr(module, name):
                setattr(module, name, _refuse)
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
