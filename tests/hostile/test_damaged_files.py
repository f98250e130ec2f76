import json
import subprocess
import sys

import pytest

from .campaign import failures
from .readers import all_readers
from .whole_files import ROOT

pytest.importorskip("pyarrow")
pytest.importorskip("mcap")
pytest.importorskip("mujoco")
pytest.importorskip("rosbags")
pytest.importorskip("trimesh")

READERS = list(all_readers())
MOST_MEGABYTES = 1000


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name.replace(" ", "-"))
def test_damaged_file_is_read_or_refused(reader):
    assert list(failures(reader, seed=38, count=5)) == []


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_no_reader_breaks_on_thousands_of_damaged_files(seed):
    """In a process of its own, so that a crash of a foreign library and the memory are seen."""
    run = subprocess.run(
        [sys.executable, "-m", "tests.hostile.campaign", str(seed), "60"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    *broken, last = map(json.loads, run.stdout.splitlines())
    assert broken == [] and last["files"] == 60 * len(READERS) > 1250
    assert last["megabytes"] < MOST_MEGABYTES


def test_undamaged_file_of_each_kind_is_read(tmp_path):
    for number, reader in enumerate(READERS):
        path = tmp_path / str(number) / reader.file
        path.parent.mkdir(parents=True)
        reader.prepare(path.parent)
        path.write_bytes(reader.content())
        assert reader.read(path) is not None, reader.name
