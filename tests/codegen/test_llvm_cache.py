from __future__ import annotations

import numpy as np
import pytest

from slidax.codegen import llvm
from slidax.codegen.llvm import cache, machine

from .test_llvm import scaled


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """Object code that is kept goes into a folder of the test's own."""
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "native")
    return tmp_path / "native"


def test_the_same_program_is_compiled_once(monkeypatch, folder):
    llvm.compile(scaled())
    (kept,) = folder.iterdir()

    def never(self, text):
        raise AssertionError("compiled again")

    monkeypatch.setattr(machine.Machine, "compiled", never)
    (y,) = llvm.compile(scaled())([np.array([1.0, 2.0]), np.array(3.0)])
    assert y.tolist() == [3.0, 6.0]
    kept.write_bytes(kept.read_bytes()[:-1])
    with pytest.raises(AssertionError, match="compiled again"):
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
