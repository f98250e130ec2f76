"""Files that are replaced as a whole, next to other writers, on full disks, and after a writer was killed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from slidax.core import writing
from slidax.core.writing import create_text, is_temporary, remove_leftovers, replace_file, write_bytes, write_text

WRITER = """
import sys, time
from slidax.core.writing import replace_file
with replace_file(sys.argv[1]) as file:
    file.write(b"half")
    file.flush()
    print("writing", flush=True)
    time.sleep(60)
"""


def temporary_files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if is_temporary(path.name)]


def test_an_error_while_writing_leaves_the_old_file_and_no_temporary_file(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    write_text(path, "old")
    with pytest.raises(ZeroDivisionError), replace_file(path) as file:
        file.write(b"%d" % (1 // 0))
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 1


def test_temporary_files_of_killed_writers_are_removed_and_of_running_writers_kept(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path / "x.txt")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None and writer.stdout.readline() == b"writing\n"
        (name,) = temporary_files(tmp_path)
        remove_leftovers(tmp_path)
        assert temporary_files(tmp_path) == [name]
        writer.kill()
        writer.wait()
    assert temporary_files(tmp_path) == [name]
    remove_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_temporary_file_of_another_machine_is_removed_after_an_hour_only(tmp_path: Path) -> None:
    path = tmp_path / ".slidax-elsewhere-12-0123456789ab.tmp"
    path.write_text("half")
    remove_leftovers(tmp_path)
    assert path.exists()
    os.utime(path, (time.time() - 3700,) * 2)
    remove_leftovers(tmp_path)
    assert not path.exists()


def test_files_that_slidax_did_not_write_are_not_removed(tmp_path: Path) -> None:
    names = ("x.tmp", ".slidax-.tmp", ".slidax-a-b-c.tmp", "000000000000-64.tmp77", ".slidax-host-1-0123456789ab.tmpx")
    for name in names:
        (tmp_path / name).write_text("mine")
        # Old enough to be removed, even if the name were that of another machine's file.
        os.utime(tmp_path / name, (time.time() - 3700,) * 2)
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_a_writer_writes_again_if_another_machine_removed_its_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removals = []

    def remove_first(handle: int) -> None:
        if not removals:
            removals.extend(path.unlink() for path in tmp_path.iterdir())

    monkeypatch.setattr(writing.os, "fsync", remove_first)
    write_text(tmp_path / "x.txt", "kept")
    assert len(removals) == 1 and (tmp_path / "x.txt").read_text() == "kept"


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "x.txt"
    write_text(path, "old")
    monkeypatch.setattr(writing.os, "fsync", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*x\.txt'"):
        write_text(path, "new")
    assert path.read_text() == "old" and temporary_files(tmp_path) == []


def test_a_missing_folder_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere/x\.txt"):
        write_text(tmp_path / "nowhere" / "x.txt", "x")


def test_create_text_does_not_overwrite_an_existing_file(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    assert create_text(path, "first")
    assert not create_text(path, "second")
    assert path.read_text() == "first" and len(list(tmp_path.iterdir())) == 1


def test_symbolic_links_and_permissions_of_a_rewritten_file_are_kept(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink() and target.read_text() == "new" and target.stat().st_mode & 0o777 == 0o640


def test_a_pipe_is_written_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        write_bytes(pipe, b"through")
        assert reader.communicate()[0] == b"through"
    assert pipe.is_fifo()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_full_device_is_an_error_that_names_it() -> None:
    with pytest.raises(OSError, match="/dev/full"):
        write_bytes("/dev/full", b"x" * 100_000)
