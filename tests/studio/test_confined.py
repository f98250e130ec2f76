import os
import subprocess
import sys
from contextlib import contextmanager

import pytest

from slidax.studio.confined import Watch


@contextmanager
def _descriptor(path):
    handle = os.open(path, os.O_RDONLY)
    try:
        yield handle
    finally:
        os.close(handle)


PROBE = """
import ctypes, errno, os, socket, sys, tempfile
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
        # Landlock calls a link from elsewhere one between two disks.
        return error.errno in (errno.EACCES, errno.EXDEV)
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
    "relative make": lambda: os.mkdir("../outside/made", 0o700),
    "relative truncate": lambda: os.truncate("../outside/secret.txt", 1),
    "relative fifo": lambda: os.mkfifo("../outside/fifo"),
    "relative move": lambda: os.rename("../outside/secret.txt", "stolen"),
    "relative hard link": lambda: os.link("../outside/secret.txt", "stolen"),
    "relative remove": lambda: os.remove("../outside/secret.txt"),
}
if not kernel_only:
    # Nothing but the first wall holds these: Landlock knows no rights for them.
    bad |= {
        "mode": lambda: os.chmod(secret, 0o777),
        "relative mode": lambda: os.chmod("../outside/secret.txt", 0o777),
        "mode through a link": lambda: os.chmod("link", 0o777),
        "time": lambda: os.utime("../outside/secret.txt", (0, 0)),
        "owner": lambda: os.chown("../outside/secret.txt", os.getuid(), os.getgid()),
        "look-up": lambda: socket.getaddrinfo("localhost", 80),
        "datagram": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", 9)),
        "socket of another": lambda: socket.socket(socket.AF_UNIX).connect("../outside/socket"),
    }
os.chdir(root)
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
def test_a_confined_process_sees_only_its_folder(tmp_path, walls):
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
    assert lines[1] in ("c True False True", "c False True True") and lines[2] == "fine"
    assert secret.read_text() == "secret"
    assert sorted(path.name for path in outside.iterdir()) == ["secret.txt"]


def test_the_audit_hook_distinguishes_reading_from_writing(tmp_path):
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


@pytest.mark.skipif(sys.platform != "linux", reason="the places of descriptors are those of /proc")
def test_the_audit_hook_refuses_every_change_outside_for_any_form_of_path(tmp_path, monkeypatch):
    root, outside = tmp_path / "root", tmp_path / "outside"
    (root / "deep" / "er").mkdir(parents=True)
    outside.mkdir()
    (outside / "file").write_text("x")
    (outside / "in").symlink_to(root / "deep")
    (root / "out").symlink_to(outside)
    (root / "own").write_text("x")
    monkeypatch.chdir(root)
    watch = Watch([outside], [root])
    with _descriptor(root) as inside, _descriptor(outside) as folder, _descriptor(outside / "file") as file:
        bad = ["../outside/new", str(outside / "new"), "out/new", "deep/../../outside/new", b"../outside/new", ".."]
        forms = [(path, -1) for path in bad]
        forms += [("new", folder), ("../outside/new", inside), ("deep/er/../../../x", inside), ("../x", inside)]
        # The link's target is in the folder, but the changed name is outside.
        forms += [(str(outside / "in"), -1), ("in", folder)]
        for path, base in forms:
            for event, arguments in (
                *(("os.mkdir", (path, 0o777, base)), ("os.remove", (path, base)), ("os.rmdir", (path, base))),
                *(("os.rename", (path, "own", base, -1)), ("os.rename", ("own", path, -1, base))),
                *(("os.link", (path, "own2", base, -1)), ("os.link", ("own", path, -1, base))),
                *(("os.symlink", ("own", path, base)), ("os.chmod", (path, 3, base))),
                *(("os.chmod", (path, 0o777, base)), ("os.chown", (path, 5, 6, base))),
                ("os.utime", (path, None, None, base)),
            ):
                with pytest.raises(PermissionError):
                    watch(event, arguments)
        for path in (*bad, "out/file", file, folder):
            for event, arguments in (
                *(("os.truncate", (path, 5)), ("os.chmod", (path, 5, -1)), ("os.utime", (path, None, None, -1))),
                *(("os.setxattr", (path, "user.x", b"", 0)), ("os.removexattr", (path, "user.x"))),
            ):
                with pytest.raises(PermissionError):
                    watch(event, arguments)
        for target, path in (("../outside", "link"), ("/etc/passwd", "link"), ("../own", "link"), ("..", "deep/../l")):
            with pytest.raises(PermissionError):
                watch("os.symlink", (target, path, -1))
        for address in (("127.0.0.1", 1), "/run/x", b"\0abstract", "../outside/socket"):
            for event in ("socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"):
                with pytest.raises(PermissionError):
                    watch(event, (None, address))


@pytest.mark.skipif(sys.platform != "linux", reason="the places of descriptors are those of /proc")
def test_the_audit_hook_allows_every_change_inside(tmp_path, monkeypatch):
    root = tmp_path / "root"
    (root / "deep").mkdir(parents=True)
    (root / "file").write_text("x")
    (root / "out").symlink_to(tmp_path)
    monkeypatch.chdir(root / "deep")
    watch = Watch([], [root])
    with _descriptor(root) as folder, _descriptor(root / "file") as file:
        for path, base in (
            *(("new", -1), ("../new", -1), (str(root / "new"), -1), ("new", folder), ("deep/../x", folder)),
        ):
            watch("os.mkdir", (path, 0o777, base))
            watch("os.rename", (path, "../x", base, -1))
            watch("os.symlink", (str(root / "file"), path, base))
            watch("os.chmod", (path, 0o600, base))
        watch("os.symlink", ("../file", "link", -1))
        watch("os.symlink", ("file", "link", folder))
        # A link out of the folder is itself a name in it.
        watch("os.remove", ("out", folder))
        watch("os.truncate", (file, 0))
        watch("os.utime", (file, None, None, -1))
        watch("socket.bind", (None, str(root / "socket")))
        watch("socket.sendmsg", (None, None))
