"""Damaged files, foreign files and several writers in a study's folder: no row is lost, and none is wrong."""

import os
import shutil
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.core.writing import is_temporary
from slidax.studies import read_rows, scenario_of_row
from slidax.studies.store import Store, count_rows

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

IDENTITY = {
    **{"study": "monte_carlo", "scenario": {"t1": 0.1 + 0.2}, "seed": 5, "made_by": {"machine": "a"}},
    **{"uncertain": {}, "varied": {}, "engine": None},
}
OTHER = {**IDENTITY, "seed": 6}

CHUNKS = {0: 64, 64: 64, 128: 64, 192: 8}


def opened(out: Path, identity: dict[str, Any] = IDENTITY, *, resume: bool = True) -> Store:
    return Store(out, identity, resume=resume, notes={"row": "number of the case"})


def chunk(first: int, rows: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(first)
    margin = random.normal(size=rows)
    margin[rows // 2] = np.nan
    return {
        "row": np.arange(first, first + rows),
        "outcome": random.integers(0, 4, rows).astype(np.int8),
        "margin": margin,
        "zero": np.full(rows, -0.0),
    }


def fill(store: Store) -> int:
    """Compute the missing rows, finish, and return the number of computed rows."""
    computed = 0
    for first, rows in CHUNKS.items():
        if store.read(first, rows) is None:
            store.write(first, chunk(first, rows))
            computed += rows
    store.finish(200)
    return computed


def same(folder: Path, other: Path) -> bool:
    return (folder / "rows.parquet").read_bytes() == (other / "rows.parquet").read_bytes()


def damage(path: Path, how: str) -> None:
    content = path.read_bytes()
    contents = {
        "empty": b"",
        "cut": content[: len(content) // 2],
        "text": b"row,outcome\n1,2\n",
        "zeros": bytes(len(content)),
    }
    if how in contents:
        path.write_bytes(contents[how])
        return
    path.unlink()
    if how == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to({"device": "/dev/zero", "dangling": "nowhere"}[how])


DAMAGES = ("empty", "cut", "text", "zeros", "device", "pipe", "dangling")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    assert fill(opened(out, resume=False)) == 200
    return out


@pytest.fixture
def out(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "out")
    return tmp_path / "out"


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_part_file_is_reported_and_computed_again(whole, out, how):
    part = out / "parts" / "000000000064-64.parquet"
    damage(part, how)
    if how == "dangling":
        assert fill(opened(out)) == 64
    else:
        with pytest.warns(DefinitionWarning, match=rf"{part.name}` .*: its 64 rows are computed again"):
            assert fill(opened(out)) == 64
    assert same(out, whole) and part.is_file() and not part.is_symlink() and count_rows(out) == 200


def test_a_changed_byte_of_a_part_file_is_detected_or_changes_no_row(whole, out):
    name = "000000000192-8.parquet"
    content = (whole / "parts" / name).read_bytes()
    expected, store, noticed = chunk(192, 8), opened(out), 0
    for place in range(0, len(content), 5):
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        (out / "parts" / name).write_bytes(changed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DefinitionWarning)
            columns = store.read(192, 8)
        noticed += columns is None
        if columns is not None:
            for key, values in expected.items():
                assert np.array_equal(columns[key], values, equal_nan=True), (place, key)
    assert noticed > 100


def test_part_files_of_another_study_or_with_other_rows_are_reported_and_computed_again(whole, out, tmp_path):
    other = tmp_path / "other"
    fill(opened(other, OTHER))
    shutil.copy(other / "parts" / "000000000064-64.parquet", out / "parts")
    shutil.copy(out / "parts" / "000000000000-64.parquet", out / "parts" / "000000000128-64.parquet")
    with pytest.warns(DefinitionWarning) as told:
        assert fill(opened(out)) == 128
    assert [str(item.message).rpartition("/")[2] for item in told] == [
        "000000000064-64.parquet` belongs to another study, or to an older version of slidax: its 64 rows are "
        "computed again",
        "000000000128-64.parquet` has other rows than those in its name: its 64 rows are computed again",
    ]
    assert same(out, whole)


def test_a_part_file_that_declares_other_rows_is_not_read(whole, out):
    """A few bytes can stand for gigabytes of equal numbers."""
    path = out / "parts" / "000000000064-64.parquet"
    marks = pq.read_schema(path).metadata
    zeros = pa.table({"row": np.zeros(10**6, int)}).replace_schema_metadata(marks)
    pq.write_table(zeros, path, compression="zstd")
    assert path.stat().st_size < 20_000
    # If the file were read, the message would be about its checksum.
    with pytest.warns(DefinitionWarning, match="has other rows than those in its name: its 64 rows are computed again"):
        assert fill(opened(out)) == 64
    assert same(out, whole)


@pytest.mark.parametrize(
    ("names", "columns", "words"),
    [
        (("row", "row"), ([1, 2], [1, 2]), "it has two columns `row`"),
        (("row",), (["a", "b"],), "column `row` has the type string, which is not numeric"),
        (("row", "q"), ([1, 2], [[1.0], [2.0]]), "column `q` has the type list.*, which is not numeric"),
    ],
    ids=["two of one name", "text", "lists"],
)
def test_a_table_with_duplicate_or_non_numeric_columns_is_refused_with_the_reason(out, names, columns, words):
    pq.write_table(pa.table([pa.array(column) for column in columns], names=names), out / "rows.parquet")
    with pytest.raises(DefinitionError, match=rf"rows\.parquet` is damaged: {words}"):
        read_rows(out)


def test_a_table_that_declares_too_many_numbers_is_refused(out, monkeypatch):
    monkeypatch.setattr("slidax.studies.store.MOST_NUMBERS", 799)
    with pytest.raises(
        DefinitionError, match=r"it has 200 rows in 4 needed columns, but at most 8e\+02 numbers are read"
    ):
        read_rows(out)


def test_reading_rows_from_a_missing_folder_is_refused_with_its_name(tmp_path):
    with pytest.raises(DefinitionError, match=r"there is no folder `.*nowhere`$"):
        read_rows(tmp_path / "nowhere")


def test_other_files_among_the_parts_are_ignored(whole, out):
    names = ("notes.parquet", "a-b.parquet", "000000000001.parquet", "-1-64.parquet", "1-64.parquet", "x.tmp")
    for name in names:
        (out / "parts" / name).write_text("mine")
    assert fill(opened(out)) == 0 and same(out, whole) and count_rows(out) == 200
    assert all((out / "parts" / name).read_text() == "mine" for name in names)


def test_a_damaged_longer_part_does_not_prevent_a_shorter_study(out):
    damage(out / "parts" / "000000000064-64.parquet", "cut")
    store = opened(out)
    store.write(64, chunk(64, 36))
    with pytest.warns(DefinitionWarning, match="000000000064-64.parquet` .*: it is skipped"):
        store.finish(100)
    assert read_rows(out)["row"].tolist() == list(range(100))


BAD_IDENTITIES = (
    None,
    "",
    "{",
    '"text"',
    "[" * 100_000,
    '{"study": "monte_carlo"}',
    "\x00" * 300,
    "1" * 5000,
    "\udcff",
)


@pytest.mark.parametrize("content", BAD_IDENTITIES)
def test_a_damaged_study_file_is_rewritten_if_the_rows_belong_to_this_study(whole, out, content):
    path = out / "study.json"
    path.unlink() if content is None else path.write_text(content, encoding="utf-8", errors="surrogateescape")
    for refused in (lambda: opened(out, resume=False), lambda: scenario_of_row(out, 3)):
        with pytest.raises(DefinitionError, match=r"study\.json` is (damaged|missing).*--resume"):
            refused()
    with pytest.raises(DefinitionError, match="belongs to another study: write to another folder"):
        opened(out, OTHER)
    with pytest.warns(DefinitionWarning, match=r"study\.json` is (damaged|missing).*: it is written again"):
        assert fill(opened(out)) == 0
    assert same(out, whole) and path.read_bytes() == (whole / "study.json").read_bytes()


@pytest.mark.parametrize("how", DAMAGES)
def test_a_damaged_table_of_rows_is_refused_on_reading_and_rewritten_on_resume(whole, out, how):
    damage(out / "rows.parquet", how)
    for refused in (lambda: read_rows(out), lambda: read_rows(out / "rows.parquet"), lambda: scenario_of_row(out, 3)):
        with pytest.raises(DefinitionError, match=r"rows\.parquet`.*--resume` writes it again"):
            refused()
    assert fill(opened(out)) == 0 and same(out, whole)


def test_replaying_a_row_from_another_studys_table_is_refused(out, tmp_path):
    fill(opened(tmp_path / "other", OTHER))
    shutil.copy(tmp_path / "other" / "rows.parquet", out)
    with pytest.raises(DefinitionError, match="belong to another study than"):
        scenario_of_row(out, 3)


def test_two_different_studies_started_at_once_in_a_folder_do_not_mix(tmp_path, monkeypatch):
    out = tmp_path / "out"
    # The second study checks the folder before the first writes to it.
    monkeypatch.setattr("slidax.studies.store._is_free", lambda folder: True)
    opened(out)
    with pytest.raises(DefinitionError, match="another study"):
        opened(out, OTHER)
    opened(out, {**IDENTITY, "made_by": {"machine": "b"}})


def test_a_folder_of_a_process_killed_at_its_start_can_be_used(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / ".slidax-elsewhere-12-0123456789ab.tmp").write_text("{")
    assert fill(opened(out, resume=False)) == 200


def test_four_simultaneous_writers_leave_the_same_table_as_a_single_writer(whole, tmp_path):
    for number in range(10):
        out, barrier = tmp_path / f"out{number}", threading.Barrier(4)
        computed: list[int] = []

        def write(out: Path = out, barrier: threading.Barrier = barrier, computed: list[int] = computed) -> None:
            barrier.wait()
            computed.append(fill(opened(out)))

        # A lock belongs to an open file, so that threads exclude each other as processes do.
        writers = [threading.Thread(target=write) for _ in range(4)]
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
        assert len(computed) == 4 and sum(computed) >= 200 and same(out, whole)
        assert not [path for path in out.rglob("*") if is_temporary(path.name)]
