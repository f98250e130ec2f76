import os
import subprocess
import sys

import pytest

from slidax.core.errors import DefinitionError
from slidax.studio.files import Folder, OutsideError, mark_of, parts_of

from .tricks import SECRET, state_of, tricks

MOST = 1000


def test_no_path_trick_reads_or_writes_a_file_outside(root):
    folder, before = Folder(root), state_of(root.parent / "outside")
    names = tricks(root)
    assert len(names) >= 40
    for name in names:
        with pytest.raises((DefinitionError, FileExistsError)):
            folder.read(name, MOST)
        # A name that is only unusual may be written in the folder.
        try:
            folder.write(name, b"x: 1\n")
        except (DefinitionError, FileExistsError):
            continue
        assert folder.resolve(name).is_relative_to(root)
    assert state_of(root.parent / "outside") == before


def test_hidden_and_executable_files_are_not_written(root):
    folder = Folder(root)
    for name in (".bashrc.yaml", ".git/hooks.yaml", "sub/.ssh/keys.json"):
        with pytest.raises(OutsideError, match="must not start"):
            folder.write(name, b"")
    for name in ("conftest.py", "run.sh", "index.html", "lib.so", "noending"):
        with pytest.raises(DefinitionError, match="must end in one of"):
            folder.write(name, b"")


def test_links_within_the_folder_are_followed(root):
    os.symlink("own.yaml", root / "inner.yaml")
    assert Folder(root).read("inner.yaml", MOST) == b"title: own\n"
    assert Folder(root).read("self/own.yaml", MOST) == b"title: own\n"


def test_a_file_is_written_atomically_and_only_over_the_version_read(root):
    folder = Folder(root)
    mark = folder.write("new/deep/one.yaml", b"a: 1\n")
    assert mark == mark_of(b"a: 1\n")
    with pytest.raises(FileExistsError):
        folder.write("new/deep/one.yaml", b"a: 2\n")
    with pytest.raises(FileExistsError):
        folder.write("new/deep/one.yaml", b"a: 2\n", before=mark_of(b"another"))
    folder.write("new/deep/one.yaml", b"a: 2\n", before=mark)
    assert (root / "new/deep/one.yaml").read_bytes() == b"a: 2\n"
    assert [path.name for path in (root / "new/deep").iterdir()] == ["one.yaml"]


def test_a_file_replaced_by_a_link_before_opening_is_not_followed(root, monkeypatch):
    folder, real = Folder(root), Folder.beneath

    def swapped(self, path, name):
        result = real(self, path, name)
        result.unlink()
        os.symlink("../outside/secret.yaml", result)
        return result

    monkeypatch.setattr(Folder, "beneath", swapped)
    with pytest.raises(OutsideError, match="link"):
        folder.read("own.yaml", MOST)


def test_a_folder_replaced_by_a_link_before_opening_is_not_followed(root, monkeypatch):
    (root / "sub" / "secret.yaml").write_text("title: own\n")
    folder, real = Folder(root), Folder.beneath

    def swapped(self, path, name):
        result = real(self, path, name)
        (root / "sub").rename(root / "moved")
        os.symlink("../outside", root / "sub")
        return result

    monkeypatch.setattr(Folder, "beneath", swapped)
    with pytest.raises(OutsideError):
        folder.read("sub/secret.yaml", MOST)
    before = state_of(root.parent / "outside")
    (root / "sub").unlink()
    (root / "moved").rename(root / "sub")
    with pytest.raises((OutsideError, FileExistsError)):
        folder.write("sub/secret.yaml", b"title: mine\n", before=mark_of(b"title: own\n"))
    assert state_of(root.parent / "outside") == before


FLIP = """
import os, sys
place, new = sys.argv[1], sys.argv[1] + ".new"
while True:
    with open(new, "w") as file:
        file.write("title: own\\n")
    os.replace(new, place)
    os.symlink("../outside/secret.yaml", new)
    os.replace(new, place)
"""


def test_a_race_with_changing_links_never_reads_a_file_outside(root):
    folder, place = Folder(root), root / "flip.yaml"
    place.write_text("title: own\n")
    read = refused = 0
    with subprocess.Popen([sys.executable, "-S", "-c", FLIP, str(place)]) as other:
        try:
            while read + refused < 20_000 and not (read > 500 and refused > 500):
                try:
                    result = folder.read("flip.yaml", MOST)
                except DefinitionError:
                    refused += 1
                else:
                    assert SECRET.encode() not in result
                    read += 1
        finally:
            other.kill()
    assert read and refused


def test_only_regular_files_within_the_size_limit_are_read(root):
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no pipes by name")
    os.mkfifo(root / "pipe.yaml")
    with pytest.raises(DefinitionError, match="not a file"):
        Folder(root).read("pipe.yaml", MOST)
    (root / "large.yaml").write_bytes(b"x" * (MOST + 1))
    with pytest.raises(DefinitionError, match="at most"):
        Folder(root).read("large.yaml", MOST)


def test_a_listing_has_readable_files_and_no_links_to_outside(root):
    (root / ".hidden.yaml").write_text("")
    (root / "run.sh").write_text("")
    (root / "sub" / "motion.csv").write_text("t\n0\n")
    assert [item.name for item in Folder(root).listing()] == ["own.yaml", "sub/motion.csv"]
    with pytest.raises(OutsideError):
        Folder(root).listing("folder")


@pytest.mark.parametrize("name", ["arm.yaml", "sub/arm-2.yaml", "Größe.yaml", "a b.csv", "x..y.yaml"])
def test_ordinary_file_names_are_accepted(name):
    assert parts_of(name) == tuple(name.split("/"))
