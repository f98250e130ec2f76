from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from slidax.studio.confined import Watch

PROBE = """
import ctypes, os, socket, sys, tempfile
from pathlib import Path
from slidax.studio.confined import confine

root, scratch, secret, kernel_only = (*map(Path, sys.argv[1:4]), sys.argv[4] == "kernel")
if kernel_only:
    import slidax.studio.confined as confined
    confined.sys.addaudithook = lambda hook: None
by_kernel = confine(root, scratch)
if kernel_only and not by_kernel:
    print("no landlock"); raise SystemExit

def refused(what):
    try:
        what()
    except OSError as error:
        return error.errno == 13
    return False

bad = {
    "read": lambda: secret.read_text(),
    "write": lambda: secret.write_text("x"),
    "new": lambda: (secret.parent / "new").write_text("x"),
    "list": lambda: os.listdir(secret.parent),
    "remove": lambda: secret.unlink(),
    "make": lambda: (secret.parent / "made").mkdir(),
    "move": lambda: os.rename(root / "own", secret.parent / "moved"),
    "link": lambda: os.symlink("/x", secret.parent / "link"),
    "through": lambda: (root / "link").read_text(),
    "home": lambda: os.listdir(os.path.expanduser("~")),
    "connect": lambda: socket.create_connection(("127.0.0.1", 9)),
}
if kernel_only:
    bad.pop("link")  # a new link is allowed by some versions; nothing is read through it
print([name for name, what in bad.items() if not refused(what)])
c = ctypes.CDLL(None)
c.fopen.restype = ctypes.c_void_p
print("c", by_kernel, bool(c.fopen(str(secret).encode(), b"r")), bool(c.fopen(str(root / "own").encode(), b"r")))
(root / "written").write_text("x")
with tempfile.TemporaryDirectory() as folder:
    Path(folder, "x").write_text("x")
print("fine")
"""


@pytest.mark.parametrize("walls", ["both", "kernel"])
def test_a_confined_process_sees_its_folder_alone(tmp_path: Path, walls: str):
    root, scratch, outside = (tmp_path / name for name in ("root", "scratch", "outside"))
    for place in (root, scratch, outside):
        place.mkdir()
    secret = outside / "secret.txt"
    secret.write_text("secret")
    (root / "own").write_text("own")
    (root / "link").symlink_to(secret)
    command = [sys.executable, "-P", "-c", PROBE, *map(str, (root, scratch, secret)), walls]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    lines = done.stdout.splitlines()
    if lines == ["no landlock"]:
        pytest.skip("the kernel has no Landlock")
    assert lines[0] == "[]", done.stdout + done.stderr
    assert lines[1] in ("c True False True", "c False True True")
    assert lines[2] == "fine"
    assert secret.read_text() == "secret"
    assert sorted(path.name for path in outside.iterdir()) == ["secret.txt"]


def test_the_watch_knows_reading_from_writing(tmp_path: Path):
    inner = tmp_path / "read"
    inner.mkdir()
    watch = Watch([inner], [tmp_path / "write"])
    watch("open", (str(inner / "x"), "r", 0))
    for arguments in ((str(inner / "x"), "w", 0), (str(inner / "x"), None, 1), (str(tmp_path / "reader"), "r", 0)):
        with pytest.raises(PermissionError):
            watch("open", arguments)
    with pytest.raises(PermissionError):
        watch("os.rename", (str(tmp_path / "write" / "x"), str(inner / "x"), -1, -1))
    watch("open", (3, "r", 0))
