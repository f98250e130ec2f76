from __future__ import annotations

import os
import shutil

import numpy as np
import pytest

from slidax.codegen import llvm
from slidax.codegen.llvm import machine

from .test_llvm import scaled


def test_a_cached_program_is_compiled_again_only_if_its_cache_file_is_damaged(folder, compilations):
    assert computed(scaled()) == computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 1
    (kept,) = folder.iterdir()
    whole = kept.read_bytes()
    for damaged in (whole[:-1], whole[:100] + bytes([whole[100] ^ 1]) + whole[101:]):
        kept.write_bytes(damaged)
        assert computed(scaled()) == [3.0, 6.0]
        assert kept.read_bytes() == whole
    assert len(compilations) == 3


def test_unwritable_cache_folder_does_not_stop_a_run(folder):
    folder.write_text("no folder")
    assert computed(scaled()) == [3.0, 6.0]


def reversed_outputs(program):
    """Another program with the same inputs and outputs."""
    y = program.outputs[0]
    y.values = tuple(reversed(y.values))
    return program


def computed(program):
    (y,) = llvm.compile(program)([np.array([1.0, 2.0]), np.array(3.0)])
    return y.tolist()


@pytest.fixture
def compilations(monkeypatch):
    """The compiled texts."""
    texts, compiled = [], machine.Machine.compiled
    monkeypatch.setattr(
        machine.Machine, "compiled", lambda self, text, level: texts.append(text) or compiled(self, text, level)
    )
    return texts


def test_the_cache_is_accessible_to_its_owner_alone(folder):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert kept.stat().st_mode & 0o777 == 0o600


def test_cache_folder_open_to_others_gets_private_permissions(folder, compilations):
    folder.mkdir(mode=0o700)
    folder.chmod(0o777)
    assert computed(scaled()) == [3.0, 6.0]
    assert folder.stat().st_mode & 0o777 == 0o700
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 1


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_cache_file_that_others_may_write_is_not_run(folder, compilations, mode):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    kept.chmod(mode)
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2
    (kept,) = folder.iterdir()
    assert kept.stat().st_mode & 0o777 == 0o600


def test_cache_folder_of_another_user_is_neither_read_nor_written(folder, compilations, monkeypatch):
    llvm.compile(scaled())
    before = sorted(folder.iterdir())
    mine = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: mine + 1)
    for program, expected in ((scaled(), [3.0, 6.0]), (reversed_outputs(scaled()), [6.0, 3.0])):
        with pytest.warns(UserWarning, match="belongs to another user"):
            assert computed(program) == expected
    assert len(compilations) == 3
    assert sorted(folder.iterdir()) == before


def test_cache_file_of_another_user_is_not_run(folder, compilations, monkeypatch):
    llvm.compile(scaled())
    fstat = os.fstat

    def others(handle):
        numbers = list(fstat(handle))
        numbers[4] += 1  # st_uid
        return os.stat_result(numbers)

    monkeypatch.setattr(machine.os, "fstat", others)
    assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2


def test_symbolic_links_in_the_cache_are_not_followed(folder, compilations, tmp_path):
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


def test_a_cache_file_under_another_files_name_is_not_run(folder, compilations):
    llvm.compile(scaled())
    (first,) = folder.iterdir()
    llvm.compile(reversed_outputs(scaled()))
    (second,) = set(folder.iterdir()) - {first}
    shutil.copy(first, second)
    assert computed(reversed_outputs(scaled())) == [6.0, 3.0]
    assert len(compilations) == 3


@pytest.mark.parametrize("what", ["another program's code", "no code at all"])
def test_cached_code_of_another_program_is_named_and_compiled_again(folder, compilations, monkeypatch, what):
    keys, store = [], machine.store_code
    monkeypatch.setattr(machine, "store_code", lambda key, body: (keys.append(key), store(key, body)))
    llvm.compile(scaled())
    (kept,) = folder.iterdir()
    body = kept.read_bytes()[machine.DIGEST :].replace(b"runs_", b"walk_") if what.startswith("another") else b"nothing"
    # The file has the right checksum.
    (key,) = keys
    store(key, body)
    with pytest.warns(UserWarning, match=f"`{kept}` is not the code of this program .* compiled again"):
        assert computed(scaled()) == [3.0, 6.0]
    assert len(compilations) == 2
