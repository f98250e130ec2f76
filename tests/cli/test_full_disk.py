import warnings
from contextlib import contextmanager

import jax
import pytest

from slidax.cli.common import errors_as_lines
from slidax.core.writing import is_temporary
from slidax.studies import read_rows

from .commands import STUDY, in_process

resource = pytest.importorskip("resource", reason="the system has no limits on file sizes")

TEXT = STUDY + "runs: 128"


@contextmanager
def no_file_above(size):
    # JAX would leave partial files in the cache of the tests. JAX looks for a cache
    # only once, but checks for each program whether its compilation was long enough to store.
    shortest = jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e9)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", shortest)


def refused(size, *words):
    with no_file_above(size):
        done = in_process(*words)
    assert done.exit_code == 2, done.output
    # A resumed study first reports the missing rows.
    lines = [line for line in done.stderr.splitlines() if "rows are missing" not in line]
    assert len(lines) == 1 and lines[0].startswith("slidax: cannot write "), done.stderr
    assert "File too large" in lines[0] and "ree some space" in lines[0]
    return lines[0]


def assert_whole(folder, size):
    for path in folder.rglob("*"):
        assert not is_temporary(path.name) and (path.is_dir() or 0 < path.stat().st_size <= size)


@pytest.mark.full
def test_report_on_a_full_disk_fails_in_one_line_without_partial_files(tmp_path):
    line = refused(20_000, "run", "example-4.1-1khz", "--set", "simulation.t1=0.1", "--out", str(tmp_path / "out"))
    assert str(tmp_path / "out") in line
    assert_whole(tmp_path, 20_000)


def test_c_project_on_a_full_disk_fails_in_one_line_without_partial_files(tmp_path):
    words = ["export", "c", "example-4.1-1khz", "--out", str(tmp_path / "c"), "--quick"]
    assert "cannot write the project to" in refused(6_000, *words)
    assert_whole(tmp_path, 6_000)


def test_a_study_on_a_full_disk_reports_saved_rows_and_resumes(tmp_path, monkeypatch):
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(TEXT, encoding="utf-8")
    for name in ("LEAST", "MOST"):
        monkeypatch.setattr(f"slidax.studies.runner.{name}", 64)
    words = ["study", str(file), "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["slidax", *words])
    line = refused(5_000, *words)
    assert "000000000000-64.parquet`" in line and f"0 rows are saved in `{out}`" in line
    # All parts fit on the disk, but the files made from them do not.
    parts = 30_000
    line = refused(parts, *words, "--resume")
    assert (
        f"128 rows are saved in `{out}`: free some space, and resume with: slidax study {file} --out {out} --resume"
        in line
    )
    assert_whole(tmp_path, parts)
    assert in_process(*words, "--resume").exit_code == 0
    assert read_rows(out)["row"].tolist() == list(range(128))


def test_full_compilation_cache_is_reported_once_and_a_damaged_cache_is_emptied(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "slidax" / f"xla-{jax.__version__}"
    folder.mkdir(parents=True)
    (folder / "jit_f-0123-cache").write_bytes(b"half")
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(folder))
    text = "Error writing persistent compilation cache entry for 'jit_f': OSError: [Errno 28] No space left on device"
    try:
        with errors_as_lines(), warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn(text, stacklevel=1)
            warnings.warn(text.replace("jit_f", "jit_g"), stacklevel=1)
            assert len(list(folder.iterdir())) == 1
            warnings.warn("Error reading persistent compilation cache entry for 'jit_f': ZstdError: half", stacklevel=1)
            warnings.warn("the arm has no friction", stacklevel=1)
    finally:
        jax.config.update("jax_compilation_cache_dir", before)
    message = capsys.readouterr().err.splitlines()
    assert len(message) == 2 and "No space left on device" in message[0] and "compiles again" in message[0]
    assert message[1] == "slidax: warning: the arm has no friction" and list(folder.iterdir()) == []
