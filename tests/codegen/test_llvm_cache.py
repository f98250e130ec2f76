from __future__ import annotations

import os
import shutil

import numpy as np
import pytest

from slidax.codegen import NoNativeCodeError, llvm
from slidax.codegen.llvm import machine
from slidax.codegen.llvm import machine as cache

from .test_llvm import scaled


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """Object code that is kept goes into a folder of the test's own."""
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "native")
    return tmp_path / "native"


def test_the_same_program_is_compiled_once(monkeypatch, folder):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()

    def never(self, text, level):
        raise AssertionError("compiled again")

    monkeypatch.setattr(machine.Machine, "compiled", never)
    (y,) = llvm.compile(scaled())([np.array([1.0, 2.0]), np.array(3.0)])
    assert y.tolist() == [3.0, 6.0]
    kept.write_bytes(kept.read_bytes()[:-1])
    with pytest.raises(NoNativeCodeError, match="compiled again"):
        llvm.compile(scaled())


def test_a_damaged_file_is_made_anew(folder):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(whole[:100] + bytes([whole[100] ^ 1]) + whole[101:])
    (y,) = llvm.compile(scaled())([np.array([1.0, 2.0]), np.array(3.0)])
    assert y.tolist() == [3.0, 6.0]
    assert kept.read_bytes() == whole


def test_a_disk_that_takes_nothing_stops_nobody(folder):
    folder.write_text("no folder")
    (y,) = llvm.compile(scaled())([np.array([1.0, 2.0]), np.array(3.0)])
    assert y.tolist() == [3.0, 6.0]


def doubled(program):
    """Another program with the same inputs and outputs."""
    y = program.outputs[0]
    y.values = tuple(reversed(y.values))
    return program


def computed(program):
    (y,) = llvm.compile(program)([np.array([1.0, 2.0]), np.array(3.0)])
    return y.tolist()


@pytest.fixture
def compilations(monkeypatch):
    """How often something was compiled."""
    made, compiled = [], machine.Machine.compiled

    def counted(self, text, level):
        made.append(text)
        return compiled(self, text, level)

    monkeypatch.setattr(machine.Machine, "compiled", counted)
    return made


def test_the_folder_and_its_files_are_for_their_owner_alone(folder):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert kept.stat().st_mode & 0o777 == 0o600


def test_a_folder_of_the_users_own_that_was_open_is_closed(folder, compilations):
    folder.mkdir(mode=0o700)
    folder.chmod(0o777)
    assert computed(scaled()) == [3.0, 6.0]
    assert folder.stat().st_mode & 0o777 == 0o700
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 1


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_may_write_is_not_run(folder, compilations, mode):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    kept.chmod(mode)
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2
    (kept,) = folder.iterdir()
    assert kept.stat().st_mode & 0o777 == 0o600


def test_a_folder_of_another_user_is_neither_read_nor_written(folder, compilations, monkeypatch):
    llvm.compile(scaled())
    before = sorted(folder.iterdir())
    mine = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: mine + 1)
    with pytest.warns(UserWarning, match="belongs to another user"):
        assert computed(scaled()) == [3.0, 6.0]
    with pytest.warns(UserWarning, match="belongs to another user"):
        assert computed(doubled(scaled())) == [6.0, 3.0]
    assert len(compilations) == 3
    assert sorted(folder.iterdir()) == before


def test_a_file_of_another_user_is_not_run(folder, compilations, monkeypatch):
    llvm.compile(scaled())
    fstat = os.fstat

    def others(handle):
        found = list(fstat(handle))
        found[4] += 1  # st_uid
        return os.stat_result(found)

    monkeypatch.setattr(cache.os, "fstat", others)
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2


def test_no_symbolic_link_is_followed(folder, compilations, tmp_path):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    elsewhere = tmp_path / "elsewhere.o"
    shutil.move(kept, elsewhere)
    kept.symlink_to(elsewhere)
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2
    shutil.move(folder, tmp_path / "moved")
    folder.symlink_to(tmp_path / "moved", target_is_directory=True)
    with pytest.warns(UserWarning, match="is a symbolic link"):
        assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 3


def test_a_file_under_the_name_of_another_is_not_run(folder, compilations):
    llvm.compile(scaled())
    (first,) = folder.iterdir()
    llvm.compile(doubled(scaled()))
    (second,) = set(folder.iterdir()) - {first}
    shutil.copy(first, second)
    assert computed(doubled(scaled())) == [6.0, 3.0]
    assert len(compilations) == 3


@pytest.mark.parametrize("what", ["another program's code", "no code at all"])
def test_kept_code_that_does_not_fit_is_named_and_compiled_anew(folder, compilations, monkeypatch, what):
    keys, store = [], cache.store_code
    monkeypatch.setattr(cache, "store_code", lambda key, body: (keys.append(key), store(key, body)))
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    body = kept.read_bytes()[cache.DIGEST :].replace(b"runs_", b"walk_") if what.startswith("another") else b"nothing"
    # With the right checksum.
    (key,) = keys
    store(key, body)
    with pytest.warns(UserWarning, match=f"`{kept}` is not the code of this program .* compiled again"):
        assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2
