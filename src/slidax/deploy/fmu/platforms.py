"""Platforms of an FMU's binaries, and their compilers."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slidax._errors import DefinitionError

OPTIONS = ("-std=c99", "-O2", "-g0", "-fPIC", "-ffp-contract=off", "-fvisibility=hidden", "-shared")
"""No -ffast-math: the answers to NaN and infinity are part of the contract."""


@dataclass(frozen=True)
class Platform:
    """A platform.

    - `name`, `older`: its folder in FMI 3.0, and in FMI 2.0.
    - `ending`: of a shared library.
    - `target`: as zig names it.
    """

    name: str
    older: str
    ending: str
    target: str

    def folder(self, fmi: int) -> str:
        """Folder of its binary inside the FMU, for FMI 3 or 2."""
        return self.name if fmi == 3 else self.older


# An old glibc, so that the library also loads on old systems.
PLATFORMS = (
    Platform("x86_64-linux", "linux64", ".so", "x86_64-linux-gnu.2.17"),
    Platform("aarch64-linux", "aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    Platform("x86_64-windows", "win64", ".dll", "x86_64-windows-gnu"),
    Platform("x86_64-darwin", "darwin64", ".dylib", "x86_64-macos"),
    Platform("aarch64-darwin", "aarch64-darwin", ".dylib", "aarch64-macos"),
)
NAMES = [each.name for each in PLATFORMS]


def zig() -> bool:
    """True if ziglang, a compiler for all platforms, is installed."""
    return importlib.util.find_spec("ziglang") is not None


def here() -> str:
    """This machine's platform, by its name in FMI 3.0."""
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return f"{machine}-{platform.system().lower()}"


def chosen(names: Sequence[str] | None) -> list[Platform]:
    """The platforms to build for; None: all, or this machine's where ziglang is not installed.

    Raises DefinitionError if a name is unknown or has no compiler.
    """
    for name in names or ():
        if name not in NAMES:
            raise DefinitionError(f"no binary can be built for `{name}`; supported: {', '.join(NAMES)}")
    able = NAMES if zig() else [name for name in NAMES if name == here() and shutil.which("cc")]
    missing = [name for name in (names if names is not None else able or [here()]) if name not in able]
    if missing:
        raise DefinitionError(f"no compiler for {', '.join(missing)} found: pip install 'slidax[fmu]'")
    return [each for each in PLATFORMS if each.name in (able if names is None else names)]


def library(where: Platform, folder: Path, sources: Sequence[str], name: str) -> bytes:
    """Compile the binary for one platform; the compiler writes to `folder`, which has the sources.

    Raises DefinitionError if the compiler fails.
    """
    binary = folder / f"{name}{where.ending}"
    if zig():
        command = [sys.executable, "-m", "ziglang", "cc", "-target", where.target, "-fno-sanitize=all", "-s"]
    else:
        command = ["cc"]
    # File names without folders, and local caches: no path of this machine gets into the binary.
    surroundings = os.environ | {"ZIG_LOCAL_CACHE_DIR": str(folder / "cache"), "SOURCE_DATE_EPOCH": "0"}
    done = subprocess.run(
        [*command, *OPTIONS, *sources, "-o", binary.name, *([] if where.ending == ".dll" else ["-lm"])],
        cwd=folder,
        env=surroundings,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        message = (done.stderr.strip().splitlines() or ["no message"])[0]
        raise DefinitionError(f"the compiler for {where.name} failed: {message}")
    return binary.read_bytes()
